/* Factors of a sparse sum of element matrices, front by front (Duff and Reid 1983). */

#ifndef FRONTS_H
#define FRONTS_H

/* Pivots are eliminated so many at a time, and what they take off the rest is added up in tiles that
   fit into registers. Rows are whole tiles long. */
enum { PANEL = 16, ROWS = 4, COLUMNS = 8 };

static inline int stride(int size) { return (size + COLUMNS - 1) / COLUMNS * COLUMNS; }

/* Elements by the unknowns that they join: `start` (elements + 1,) into `unknown`. */
typedef struct {
    int unknowns, elements;
    const int *start, *unknown;
} Joined;

/* The fronts that an order of elimination makes, each after those below it. Who calls
   `minimum_degree` brings the arrays, of as many entries as unknowns or elements. */
typedef struct {
    int fronts;
    int *of_unknown, *of_element; /* the front that eliminates, and that adds up */
    int *parent, *border;         /* the front above, -1 at the top; how many unknowns stay */
} Order;

int minimum_degree(Joined joined, Order *found);

/* `size` unknowns, the first `pivots` of which are eliminated. */
typedef struct {
    int pivots, size, first; /* `first`: where its pivots are in the order */
    int symmetric;
    int last_child, sibling; /* the child before the last, and so on; -1 at the end */
    int elements, first_element;
    int *border;    /* (size - pivots,) places in the order of the unknowns that stay */
    int *in_parent; /* (size - pivots,) and in the parent, */
    int *run;       /* (size - pivots,) up to where they follow one another there */
    double *upper, *lower; /* (pivots, stride) U, and (L D)^T, which are one if symmetric */
} Front;

typedef struct {
    int unknowns, fronts, negative;
    Front *front;
    double *inverse; /* (unknowns,) of the pivots */
    int *displacement; /* (unknowns,) its number by its place in the order */
    /* of each element: its group, its number in it, and its free displacements, by their number
       in the element and in the front, which rises */
    int *group, *in_group, *start, *column, *local;
    int *element; /* (elements,) front by front */
    double *values, *stack, *work;
    int *numbers;
} Fronts;

/* `dofs[g]` (count[g], width[g]) of each group; `symmetric[g]`: so are its matrices. */
typedef struct {
    int groups;
    const int *count, *width, *symmetric;
    const long long *const *dofs;
} Groups;

Fronts *plan_fronts(int size, Groups groups, int unknowns, const long long *free_dofs);
void free_fronts(Fronts *fronts);
/* Whether all pivots are numbers other than zero. `matrices[g]` (count[g], width[g], width[g]). */
int factor_fronts(Fronts *fronts, const int *width, const double *const *matrices);
/* Displacements `x` under `force`, both (size,); fixed ones stay. */
void solve_fronts(const Fronts *fronts, const double *force, double *x);

#endif
