/* Sums of element matrices of a solid's nodes, and of the fronts of their factors. */

#ifndef SOLIDS_H
#define SOLIDS_H

#include "kernel.h"

enum { WEDGE_NODES = 18 };

/* Tangents (m, 3, 18, 3, 18) of wedges with `points` quadrature points, at gradients (m, points, 18,
   3), F and its inverse's transpose `h` (m, points, 3, 3), and `slopes` (m, points, 4), each times
   the point's weight: what dP/dF has of h h, of h h turned, of F h and of ones. */
void wedge_tangents(const double *gradient, const double *f, const double *h, const double *slopes,
                    int m, int points, float *tangents);

/* Adds `m` matrices (3, k, 3, k) of elements to `sums` (n, 3, 3); `place` (m, k, k) says where. */
void join_blocks(const float *blocks, int m, int k, const long long *place, float *sums);

/* y = A x (3 rows,) for a matrix of 3 x 3 `blocks` at their `columns`, those of each row from one of
   `starts` (rows + 1,) to the next; y is not x. */
void block_product(const float *blocks, const long long *columns, const long long *starts, int rows,
                   const float *x, float *y);

/* Adds the upper half of `update` (3 border, 3 border) to the front above, at its nodes `at` (border,),
   which grow: to the rows of its `pivots` in `top` (pivots, pivots + beyond), to the others in `rest`
   (beyond, beyond). Columns lie one after another. */
void extend_front(const float *update, int border, const long long *at, float *top, int pivots,
                  float *rest, int beyond);

/* Forward substitution in `x` by a front's `pivots`: `own` of them in `x`, upper triangular `root`
   (pivots, pivots) and `coupled` (pivots, beyond), the latter of the displacements `border` (beyond,)
   in `x`. Columns lie one after another. */
void front_down(const float *root, const float *coupled, int pivots, const long long *border,
                int beyond, float *own, float *x);

/* Back substitution, likewise. */
void front_up(const float *root, const float *coupled, int pivots, const long long *border,
              int beyond, float *own, float *x);

#endif
