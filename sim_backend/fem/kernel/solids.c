/* What solids add up: sim_backend/fem/solid/linear.py and fronts.py. */

#include <stddef.h>

#include "solids.h"

FAST void join_blocks(const float *blocks, int m, int k, const long long *place, double *sums) {
    for (int e = 0; e < m; e++, blocks += 9 * k * k, place += k * k)
        for (int a = 0; a < k; a++)
            for (int b = 0; b < k; b++) {
                double *sum = sums + 9 * place[k * a + b];
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        sum[3 * i + j] += blocks[3 * k * (k * i + a) + k * j + b];
            }
}

/* Columns lie one after another. */
FAST void extend_front(const float *update, int border, const long long *at, float *top, int pivots,
                       float *rest, int beyond) {
    for (int b = 0; b < border; b++)
        for (int j = 0; j < 3; j++, update += 3 * border) {
            ptrdiff_t column = 3 * at[b] + j;
            for (int a = 0; a <= b; a++) {
                ptrdiff_t row = 3 * at[a];
                float *into = row < pivots ? top + column * pivots + row
                                           : rest + (column - pivots) * beyond + (row - pivots);
                for (int i = 0; i < (a < b ? 3 : j + 1); i++) into[i] += update[3 * a + i];
            }
        }
}
