/* What solids add up: sim_backend/fem/solid/linear.py and fronts.py. */

#include <stddef.h>

#include "solids.h"

#include <string.h>

/* The blocks on the diagonal and to the right of it: tangents are symmetric. */
static inline void add_point(const float *g, const float *h_g, const float *f_g, const double *slope,
                             float *tangent) {
    enum { N = WEDGE_NODES };
    float half[3 * N], alike[N];
    for (int ia = 0; ia < 3 * N; ia++)
        half[ia] = (float)(0.5 * slope[0]) * h_g[ia] - (float)slope[2] * f_g[ia];
    for (int i = 0; i < 3; i++)
        for (int a = 0; a < N; a++) {
            float *row = tangent + 3 * N * (N * i + a), x = half[N * i + a], y = h_g[N * i + a];
            for (int jb = N * i; jb < 3 * N; jb++) row[jb] += x * h_g[jb] + y * half[jb];
            for (int j = i; j < 3; j++) {
                float z = (float)slope[1] * h_g[N * j + a];
                for (int b = 0; b < N; b++) row[N * j + b] += z * h_g[N * i + b];
            }
        }
    for (int a = 0; a < N; a++) {
        float by[3];
        for (int k = 0; k < 3; k++) by[k] = (float)slope[3] * g[N * k + a];
        for (int b = 0; b < N; b++) alike[b] = by[0] * g[b] + by[1] * g[N + b] + by[2] * g[2 * N + b];
        for (int i = 0; i < 3; i++)
            for (int b = 0; b < N; b++) tangent[3 * N * (N * i + a) + N * i + b] += alike[b];
    }
}

FAST void wedge_tangents(const double *gradient, const double *f, const double *h, const double *slopes,
                         int m, int points, float *tangents) {
    enum { N = WEDGE_NODES };
    for (int e = 0; e < m; e++, tangents += 9 * N * N) {
        memset(tangents, 0, 9 * N * N * sizeof *tangents);
        for (int q = 0; q < points; q++, gradient += 3 * N, f += 9, h += 9, slopes += 4) {
            float g[3 * N], h_g[3 * N], f_g[3 * N];
            for (int i = 0; i < 3; i++)
                for (int a = 0; a < N; a++) {
                    const double *at = gradient + 3 * a;
                    g[N * i + a] = (float)at[i];
                    h_g[N * i + a] = (float)(h[3 * i] * at[0] + h[3 * i + 1] * at[1] + h[3 * i + 2] * at[2]);
                    f_g[N * i + a] = (float)(f[3 * i] * at[0] + f[3 * i + 1] * at[1] + f[3 * i + 2] * at[2]);
                }
            add_point(g, h_g, f_g, slopes, tangents);
        }
        for (int ia = N; ia < 3 * N; ia++)
            for (int jb = 0; jb < ia / N * N; jb++)
                tangents[3 * N * ia + jb] = tangents[3 * N * jb + ia];
    }
}

FAST void join_blocks(const float *blocks, int m, int k, const long long *place, float *sums) {
    for (int e = 0; e < m; e++, blocks += 9 * k * k, place += k * k)
        for (int a = 0; a < k; a++)
            for (int b = 0; b < k; b++) {
                float *sum = sums + 9 * place[k * a + b];
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        sum[3 * i + j] += blocks[3 * k * (k * i + a) + k * j + b];
            }
}

FAST void block_product(const float *blocks, const long long *columns, const long long *starts, int rows,
                        const float *x, float *y) {
    for (int row = 0; row < rows; row++, y += 3) {
        float sum[9] = {0};
        for (long long b = starts[row]; b < starts[row + 1]; b++) {
            const float *block = blocks + 9 * b, *at = x + 3 * columns[b];
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) sum[3 * i + j] += block[3 * i + j] * at[j];
        }
        for (int i = 0; i < 3; i++) y[i] = sum[3 * i] + sum[3 * i + 1] + sum[3 * i + 2];
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

/* Sums in lanes, which a compiler may not do by itself: they are rounded otherwise. */
#define LANES 16

static inline float dot(const float *a, const float *b, int n) {
    float part[LANES] = {0}, sum = 0;
    int i = 0;
    for (; i + LANES <= n; i += LANES)
        for (int k = 0; k < LANES; k++) part[k] += a[i + k] * b[i + k];
    for (; i < n; i++) sum += a[i] * b[i];
    for (int k = 0; k < LANES; k++) sum += part[k];
    return sum;
}

FAST void front_down(const float *root, const float *coupled, int pivots, const long long *border,
                     int beyond, float *own, float *x) {
    for (int j = 0; j < pivots; j++, root += pivots)
        own[j] = (own[j] - dot(root, own, j)) / root[j];
    for (int b = 0; b < beyond; b++, coupled += pivots) x[border[b]] -= dot(coupled, own, pivots);
}

FAST void front_up(const float *root, const float *coupled, int pivots, const long long *border,
                   int beyond, float *own, float *x) {
    int b = 0;
    for (; b + 4 <= beyond; b += 4, coupled += 4 * (ptrdiff_t)pivots) {
        const float *second = coupled + pivots, *third = second + pivots, *fourth = third + pivots;
        float by[4];
        for (int k = 0; k < 4; k++) by[k] = x[border[b + k]];
        for (int i = 0; i < pivots; i++)
            own[i] -= by[0] * coupled[i] + by[1] * second[i] + by[2] * third[i] + by[3] * fourth[i];
    }
    for (; b < beyond; b++, coupled += pivots)
        for (int i = 0; i < pivots; i++) own[i] -= x[border[b]] * coupled[i];
    root += (ptrdiff_t)pivots * pivots;
    for (int j = pivots - 1; j >= 0; j--) {
        root -= pivots;
        float share = own[j] /= root[j];
        for (int i = 0; i < j; i++) own[i] -= share * root[i];
    }
}
