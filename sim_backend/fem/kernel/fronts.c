/* Factors and solutions of planned fronts.

   A front gathers its elements and what the fronts below it leave, eliminates its pivots, and
   leaves the rest to the front above. Pivots are taken as they come: tangents are nearly symmetric,
   and where no eigenvalue is negative all pivots are positive. */

#include <math.h>
#include <string.h>

#include "fronts.h"
#include "kernel.h"

/* Add the front's elements; the upper half is enough of a symmetric one. */
static void gather(const Fronts *all, const Front *front, const int *width,
                   const double *const *matrices, double *f, int n) {
    for (int k = 0; k < front->elements; k++) {
        int e = all->element[front->first_element + k], g = all->group[e], d = width[g];
        int low = all->start[e], count = all->start[e + 1] - low;
        const int *column = all->column + low, *local = all->local + low;
        const double *matrix = matrices[g] + (size_t)all->in_group[e] * (size_t)(d * d);
        for (int a = 0; a < count; a++) {
            const double *from = matrix + (size_t)column[a] * d;
            double *to = f + (size_t)local[a] * n;
            for (int b = front->symmetric ? a : 0; b < count; b++) to[local[b]] += from[column[b]];
        }
    }
}

static inline void add(double *to, const double *from, int count) {
    int j = 0;
    for (; j + 4 <= count; j += 4)
        for (int b = 0; b < 4; b++) to[j + b] += from[j + b];
    for (; j < count; j++) to[j] += from[j];
}

/* Add what a child leaves (count, count). Of a symmetric one the upper half is there. */
FAST static void extend(const Front *child, int symmetric, const double *left, double *f, int n) {
    int count = child->size - child->pivots;
    const int *place = child->in_parent, *run = child->run;
    for (int i = 0; i < count; i++) {
        const double *from = left + (size_t)i * count;
        double *to = f + (size_t)place[i] * n;
        for (int j = child->symmetric ? i : 0; j < count; j = run[j])
            add(to + place[j], from + j, run[j] - j);
        if (child->symmetric && !symmetric)
            for (int j = i + 1; j < count; j++) f[(size_t)place[j] * n + place[i]] += from[j];
    }
}

/* Take off rows and columns from `first` of f what the panel's pivots take off them. */
FAST static void take_off(int panel, const double *upper, const double *scaled, int first,
                          int symmetric, double *f, int n) {
    for (int i = first / ROWS * ROWS; i < n; i += ROWS)
        for (int j = (symmetric ? i : first) / COLUMNS * COLUMNS; j < n; j += COLUMNS) {
            double tile[ROWS][COLUMNS] = {{0}};
            for (int k = 0; k < panel; k++) {
                const double *row = upper + (size_t)k * n + j, *by = scaled + (size_t)k * n + i;
                for (int a = 0; a < ROWS; a++)
                    for (int b = 0; b < COLUMNS; b++) tile[a][b] += by[a] * row[b];
            }
            for (int a = 0; a < ROWS; a++)
                for (int b = 0; b < COLUMNS; b++) f[(size_t)(i + a) * n + j + b] -= tile[a][b];
        }
}

/* Whole rows of tiles: what is before `from` in them is not needed any more. */
FAST static void subtract(double *row, double times, const double *other, int from, int n) {
    for (int j = from / COLUMNS * COLUMNS; j < n; j += COLUMNS)
        for (int b = 0; b < COLUMNS; b++) row[j + b] -= times * other[j + b];
}

FAST static void scale(double *row, double times, const double *other, int n) {
    for (int j = 0; j < n; j += COLUMNS)
        for (int b = 0; b < COLUMNS; b++) row[j + b] = times * other[j + b];
}

/* Rows of U and of (L D)^T of one panel from `low` to `high`; 0 where a pivot is no number. */
static int panel(Fronts *all, const Front *front, int low, int high, const double *f, int n,
                 double *scaled) {
    for (int k = low; k < high; k++) {
        double *upper = front->upper + (size_t)k * n, *lower = front->lower + (size_t)k * n;
        memcpy(upper, f + (size_t)k * n, sizeof(double) * (size_t)n);
        if (!front->symmetric)
            for (int i = 0; i < n; i++) lower[i] = f[(size_t)i * n + k];
        for (int s = low; s < k; s++) {
            const double *above = front->upper + (size_t)s * n;
            const double *before = front->lower + (size_t)s * n;
            double inverse = all->inverse[front->first + s];
            double times = before[k] * inverse, across = above[k] * inverse;
            subtract(upper, times, above, k, n);
            if (!front->symmetric) subtract(lower, across, before, k, n);
        }
        double pivot = upper[k];
        if (pivot == 0 || !isfinite(pivot)) return 0;
        all->negative += pivot < 0;
        all->inverse[front->first + k] = 1 / pivot;
        scale(scaled + (size_t)(k - low) * n, 1 / pivot, lower, n);
    }
    return 1;
}

static int eliminate(Fronts *all, const Front *front, double *f, int n, double *scaled) {
    for (int low = 0; low < front->pivots; low += PANEL) {
        int high = low + PANEL < front->pivots ? low + PANEL : front->pivots;
        if (!panel(all, front, low, high, f, n, scaled)) return 0;
        take_off(high - low, front->upper + (size_t)low * n, scaled, high, front->symmetric, f, n);
    }
    return 1;
}

int factor_fronts(Fronts *all, const int *width, const double *const *matrices) {
    double *top = all->stack;
    all->negative = 0;
    for (int number = 0; number < all->fronts; number++) {
        Front *front = all->front + number;
        int n = stride(front->size), rest = front->size - front->pivots;
        double *f = all->work, *scaled = f + (size_t)n * n;
        memset(f, 0, sizeof(double) * (size_t)n * n);
        gather(all, front, width, matrices, f, n);
        for (int c = front->last_child; c >= 0; c = all->front[c].sibling) {
            const Front *child = all->front + c;
            int count = child->size - child->pivots;
            top -= (size_t)count * count;
            extend(child, front->symmetric, top, f, n);
        }
        if (!eliminate(all, front, f, n, scaled)) return 0;
        for (int i = 0; i < rest; i++)
            memcpy(top + (size_t)i * rest, f + (size_t)(front->pivots + i) * n + front->pivots,
                   sizeof(double) * (size_t)rest);
        top += (size_t)rest * rest;
    }
    return 1;
}

FAST static double product(const double *row, const double *x, int from, int n) {
    double sum[4] = {0};
    int j = from;
    for (; j + 4 <= n; j += 4)
        for (int k = 0; k < 4; k++) sum[k] += row[j + k] * x[j + k];
    for (; j < n; j++) sum[0] += row[j] * x[j];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

void solve_fronts(const Fronts *all, const double *force, double *x) {
    double *y = all->work, *here = y + all->unknowns;
    for (int k = 0; k < all->unknowns; k++) y[k] = force[all->displacement[k]];
    for (int number = 0; number < all->fronts; number++) {
        const Front *front = all->front + number;
        int n = stride(front->size), rest = front->size - front->pivots;
        memset(here, 0, sizeof(double) * (size_t)n);
        memcpy(here, y + front->first, sizeof(double) * (size_t)front->pivots);
        for (int k = 0; k < front->pivots; k++) {
            y[front->first + k] = here[k];
            subtract(here, here[k] * all->inverse[front->first + k],
                     front->lower + (size_t)k * n, k + 1, n);
        }
        for (int i = 0; i < rest; i++) y[front->border[i]] += here[front->pivots + i];
    }
    for (int number = all->fronts - 1; number >= 0; number--) {
        const Front *front = all->front + number;
        int n = stride(front->size), rest = front->size - front->pivots;
        memcpy(here, y + front->first, sizeof(double) * (size_t)front->pivots);
        for (int i = 0; i < rest; i++) here[front->pivots + i] = y[front->border[i]];
        for (int k = front->pivots - 1; k >= 0; k--) {
            double sum = product(front->upper + (size_t)k * n, here, k + 1, front->size);
            here[k] = (here[k] - sum) * all->inverse[front->first + k];
        }
        memcpy(y + front->first, here, sizeof(double) * (size_t)front->pivots);
    }
    for (int k = 0; k < all->unknowns; k++) x[all->displacement[k]] = y[k];
}
