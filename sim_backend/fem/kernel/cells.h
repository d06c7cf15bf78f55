/* Cells of a plane section, as in sim_backend/fem/elements.py. */

#ifndef CELLS_H
#define CELLS_H

#include "kernel.h"

enum { PLANE_STRESS, PLANE_STRAIN, MEAN_DILATATION };

/* `m` cells of `k` nodes and `q` points: `nodes` (m, k), `gradient` (m, q, 2, k) [1/m], `weight`
   (m, q) [m2], `shear` and `bulk` (m,) [Pa]. */
typedef struct {
    int m, k, q, law;
    const long long *nodes;
    const double *gradient, *weight, *shear, *bulk;
} Cells;

/* Displacements `u` (n, 2); `root` (m, q): the cube root of J. */
double least_area_ratio(const Cells *cells, const double *u);
void cell_forces(const Cells *cells, const double *u, double *force, double *root);
/* `change` (n, 2) or NULL: see `sim_backend.fem.internal.internal_forces`. */
void cell_tangents(const Cells *cells, const double *u, const double *change,
                   const double *root, double *tangent);

/* `s` sides of a lumen and `q` points: `nodes` and `place` as of cells with `k` nodes, `spread` and
   `along` (q, k), `gradient` (s, q, 2, k); `free` to thin. */
typedef struct {
    int s, k, q, free;
    const long long *nodes;
    const double *place, *spread, *along, *gradient, *shear, *bulk;
} Sides;

void unit_pressure(const Sides *sides, const double *u, double *force, double *tangent);

#endif
