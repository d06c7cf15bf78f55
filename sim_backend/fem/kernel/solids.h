/* Sums of element matrices of a solid's nodes, and of the fronts of their factors. */

#ifndef SOLIDS_H
#define SOLIDS_H

#include "kernel.h"

/* Adds `m` matrices (3, k, 3, k) of elements to `sums` (n, 3, 3); `place` (m, k, k) says where. */
void join_blocks(const float *blocks, int m, int k, const long long *place, double *sums);

/* Adds the upper half of `update` (3 border, 3 border) to the front above, at its nodes `at` (border,),
   which grow: to the rows of its `pivots` in `top` (pivots, pivots + beyond), to the others in `rest`
   (beyond, beyond). Columns lie one after another. */
void extend_front(const float *update, int border, const long long *at, float *top, int pivots,
                  float *rest, int beyond);

#endif
