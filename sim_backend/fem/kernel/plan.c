/* Fronts of an order of elimination: small ones joined, and where everything goes in them. */

#include <stdlib.h>
#include <string.h>

#include "fronts.h"
#include "kernel.h"

/* Two fronts are joined where that costs no more operations. What each clears, copies and adds up
   counts as so many for every entry; from 3 to 12 the factors of 2,507 and of 7,043 unknowns take
   the same time within 5 %. */
enum { PER_ENTRY = 8 };

static double cost(double pivots, double border) {
    double size = pivots + border;
    return pivots * (border * border + pivots * border + pivots * pivots / 3) +
           PER_ENTRY * size * size;
}

/* What is needed only while planning. */
typedef struct {
    Order order;
    int elements;
    int *joined;        /* unknowns, element by element */
    int *pivots, *into; /* of the order's fronts: how many, and the front that each is now part of */
    int *child, *sibling, *number;
    int *place; /* of unknowns, in the order */
    int *where, *stamp; /* of places: in the front, and the last front that has them */
} Scratch;

/* Cut one piece of memory for `count` arrays; 0: there is none. */
static int *cut(int count, int **parts[], const size_t *sizes) {
    size_t total = 1;
    for (int k = 0; k < count; k++) total += sizes[k];
    int *whole = calloc(total, sizeof(int)), *at = whole;
    for (int k = 0; whole && k < count; at += sizes[k++]) *parts[k] = at;
    return whole;
}

/* List the free displacements of all elements. */
static void list(Fronts *all, Groups groups, const int *unknown, int *joined) {
    int e = 0, k = 0;
    for (int g = 0; g < groups.groups; g++)
        for (int i = 0; i < groups.count[g]; i++, e++) {
            const long long *dofs = groups.dofs[g] + (size_t)i * (size_t)groups.width[g];
            all->group[e] = g;
            all->in_group[e] = i;
            for (int a = 0; a < groups.width[g]; a++) {
                if (unknown[dofs[a]] < 0) continue;
                all->column[k] = a;
                joined[k++] = unknown[dofs[a]];
            }
            all->start[e + 1] = k;
        }
}

/* Join fronts with those above them where that pays. */
static void join(const Order *order, int *pivots, int *into) {
    for (int f = 0; f < order->fronts; f++) into[f] = f;
    for (int f = 0; f < order->fronts; f++) {
        int above = order->parent[f];
        if (above < 0) continue;
        double apart = cost(pivots[f], order->border[f]) + cost(pivots[above], order->border[above]);
        if (cost(pivots[f] + pivots[above], order->border[above]) > apart) continue;
        into[f] = above;
        pivots[above] += pivots[f];
    }
    for (int f = order->fronts - 1; f >= 0; f--) into[f] = into[into[f]];
}

static int above(const Scratch *s, int f) {
    return s->order.parent[f] < 0 ? -1 : s->into[s->order.parent[f]];
}

/* Number the fronts so that each follows those below it, branch by branch; how many there are. */
static int renumber(Scratch *s) {
    int count = 0, top = -1;
    for (int f = 0; f < s->order.fronts; f++) s->child[f] = -1;
    for (int f = s->order.fronts - 1; f >= 0; f--) {
        if (s->into[f] != f) continue;
        int *first = above(s, f) < 0 ? &top : s->child + above(s, f);
        s->sibling[f] = *first;
        *first = f;
    }
    for (int f = top; f >= 0; f = s->sibling[f] >= 0 ? s->sibling[f] : above(s, f)) {
        while (s->child[f] >= 0) {
            int below = s->child[f];
            s->child[f] = -1;
            f = below;
        }
        s->number[f] = count++;
    }
    return count;
}

static int front_of(const Scratch *s, int f) { return s->number[s->into[f]]; }

/* Give each front its children, pivots and elements. */
static void share_out(Fronts *all, Scratch *s, Groups groups) {
    int *cursor = s->where;
    for (int f = 0; f < all->fronts; f++)
        all->front[f] = (Front){.last_child = -1, .sibling = -1, .symmetric = 1};
    for (int f = 0; f < s->order.fronts; f++)
        if (s->into[f] == f) s->child[s->number[f]] = above(s, f) < 0 ? -1 : front_of(s, above(s, f));
    for (int v = 0; v < all->unknowns; v++) all->front[front_of(s, s->order.of_unknown[v])].pivots++;
    for (int e = 0; e < s->elements; e++) {
        Front *front = all->front + front_of(s, s->order.of_element[e]);
        front->elements++;
        front->symmetric &= groups.symmetric[all->group[e]];
    }
    for (int f = 0, first = 0, element = 0; f < all->fronts; f++) {
        Front *front = all->front + f;
        cursor[f] = front->first = first;
        first += front->pivots;
        front->first_element = element;
        element += front->elements;
        if (s->child[f] < 0) continue;
        front->sibling = all->front[s->child[f]].last_child;
        all->front[s->child[f]].last_child = f;
        all->front[s->child[f]].symmetric &= front->symmetric;
    }
    for (int v = 0; v < all->unknowns; v++)
        s->place[v] = cursor[front_of(s, s->order.of_unknown[v])]++;
    for (int f = 0; f < all->fronts; f++) cursor[f] = all->front[f].first_element;
    for (int e = 0; e < s->elements; e++)
        all->element[cursor[front_of(s, s->order.of_element[e])]++] = e;
}

static int by_number(const void *a, const void *b) { return *(const int *)a - *(const int *)b; }

/* Add a place to those that a front of `last` pivots leaves, if it is not there yet. */
static int reach(Scratch *s, int place, int last, int front, int *border, int count) {
    if (place < last || s->stamp[place] == front + 1) return count;
    s->stamp[place] = front + 1;
    border[count] = place;
    return count + 1;
}

/* Where an element's displacements are in its front, in the order in which they are there. */
static void enter(Fronts *all, const Scratch *s, int e) {
    int low = all->start[e];
    for (int i = low; i < all->start[e + 1]; i++) {
        int place = s->where[s->place[s->joined[i]]], column = all->column[i], at = i;
        for (; at > low && all->local[at - 1] > place; at--) {
            all->local[at] = all->local[at - 1];
            all->column[at] = all->column[at - 1];
        }
        all->local[at] = place;
        all->column[at] = column;
    }
}

/* The border of a front, and where its elements' unknowns and its children's borders are in it;
   0: no memory. */
static int lay_out(Fronts *all, Scratch *s, int f, int *border) {
    Front *front = all->front + f;
    int last = front->first + front->pivots, count = 0;
    for (int k = 0; k < front->elements; k++) {
        int e = all->element[front->first_element + k];
        for (int i = all->start[e]; i < all->start[e + 1]; i++)
            count = reach(s, s->place[s->joined[i]], last, f, border, count);
    }
    for (int c = front->last_child; c >= 0; c = all->front[c].sibling)
        for (int i = 0; i < all->front[c].size - all->front[c].pivots; i++)
            count = reach(s, all->front[c].border[i], last, f, border, count);
    qsort(border, (size_t)count, sizeof(int), by_number);
    front->size = front->pivots + count;
    front->border = malloc(sizeof(int) * 3 * (size_t)(count + 1));
    if (!front->border) return 0;
    front->in_parent = front->border + count;
    front->run = front->in_parent + count;
    memcpy(front->border, border, sizeof(int) * (size_t)count);
    for (int i = 0; i < front->pivots; i++) s->where[front->first + i] = i;
    for (int i = 0; i < count; i++) s->where[border[i]] = front->pivots + i;
    for (int k = 0; k < front->elements; k++)
        enter(all, s, all->element[front->first_element + k]);
    for (int c = front->last_child; c >= 0; c = all->front[c].sibling) {
        const Front *child = all->front + c;
        for (int i = child->size - child->pivots - 1, end = i + 1; i >= 0; i--) {
            child->in_parent[i] = s->where[child->border[i]];
            if (i + 1 < end && child->in_parent[i + 1] != child->in_parent[i] + 1) end = i + 1;
            child->run[i] = end;
        }
    }
    return 1;
}

/* Memory for the factors and for what is worked on; 0: there is none. */
static int make_room(Fronts *all) {
    size_t values = 0, stack = 0, deepest = 0, work = 2 * (size_t)all->unknowns + 2 * COLUMNS;
    for (int f = 0; f < all->fronts; f++) {
        Front *front = all->front + f;
        size_t n = (size_t)stride(front->size), rest = (size_t)(front->size - front->pivots);
        for (int c = front->last_child; c >= 0; c = all->front[c].sibling) {
            size_t left = (size_t)(all->front[c].size - all->front[c].pivots);
            stack -= left * left;
        }
        stack += rest * rest;
        if (stack > deepest) deepest = stack;
        if (n * (n + PANEL) > work) work = n * (n + PANEL);
        values += (front->symmetric ? 1 : 2) * n * (size_t)front->pivots;
    }
    size_t total = values + deepest + work + 2 * (size_t)all->unknowns + 1;
    double *at = all->values = malloc(sizeof(double) * total);
    if (!at) return 0;
    for (int f = 0; f < all->fronts; f++) {
        Front *front = all->front + f;
        size_t each = (size_t)stride(front->size) * (size_t)front->pivots;
        front->upper = at;
        front->lower = front->symmetric ? at : at + each;
        at += (front->symmetric ? 1 : 2) * each;
    }
    all->stack = at;
    all->work = at + deepest;
    all->inverse = all->work + work;
    return 1;
}

static int plan(Fronts *all, Scratch *s, Groups groups) {
    Joined joined = {all->unknowns, s->elements, all->start, s->joined};
    if (!minimum_degree(joined, &s->order)) return 0;
    for (int v = 0; v < all->unknowns; v++) s->pivots[s->order.of_unknown[v]]++;
    join(&s->order, s->pivots, s->into);
    all->fronts = renumber(s);
    all->front = calloc((size_t)all->fronts + 1, sizeof(Front));
    if (!all->front) return 0;
    share_out(all, s, groups);
    for (int f = 0; f < all->fronts; f++)
        if (!lay_out(all, s, f, s->pivots)) return 0;
    return make_room(all);
}

Fronts *plan_fronts(int size, Groups groups, int unknowns, const long long *free_dofs) {
    size_t n = (size_t)unknowns, m = 0, total = 0;
    for (int g = 0; g < groups.groups; g++) {
        m += (size_t)groups.count[g];
        total += (size_t)groups.count[g] * (size_t)groups.width[g];
    }
    Fronts *all = calloc(1, sizeof(Fronts));
    if (!all) return NULL;
    Scratch s = {.elements = (int)m};
    int *unknown;
    int **kept[] = {&all->displacement, &all->group, &all->in_group, &all->start, &all->element,
                    &all->column, &all->local};
    all->numbers = cut(7, kept, (size_t[]){n, m, m, m + 1, m, total, total});
    int **scratch[] = {&unknown, &s.joined, &s.order.of_unknown, &s.order.of_element,
                       &s.order.parent, &s.order.border, &s.pivots, &s.into, &s.child, &s.sibling,
                       &s.number, &s.place, &s.where, &s.stamp};
    int *whole = cut(14, scratch, (size_t[]){(size_t)size, total, n, m, n, n, n, n, n, n, n, n, n, n});
    all->unknowns = unknowns;
    int done = 0;
    if (all->numbers && whole) {
        for (int d = 0; d < size; d++) unknown[d] = -1;
        for (int v = 0; v < unknowns; v++) unknown[free_dofs[v]] = v;
        list(all, groups, unknown, s.joined);
        done = plan(all, &s, groups);
        if (done)
            for (int v = 0; v < unknowns; v++) all->displacement[s.place[v]] = (int)free_dofs[v];
    }
    free(whole);
    if (done) return all;
    free_fronts(all);
    return NULL;
}

void free_fronts(Fronts *all) {
    for (int f = 0; all->front && f < all->fronts; f++) free(all->front[f].border);
    free(all->front);
    free(all->numbers);
    free(all->values);
    free(all);
}
