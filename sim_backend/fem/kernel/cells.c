/* Forces and tangents of the cells of a plane section: sim_backend/fem/internal.py. */

#include <stddef.h>

#include "cells.h"
#include "material.h"

enum { MOST_NODES = 8, MOST_POINTS = 4 };

static inline const double *gradient(const Cells *c, int m, int q) {
    return c->gradient + ((size_t)m * c->q + q) * 2 * c->k;
}

FAST double least_area_ratio(const Cells *c, const double *u) {
    double least = INFINITY, here[2 * MOST_NODES];
    for (int m = 0; m < c->m; m++) {
        local(c->nodes + (size_t)m * c->k, c->k, u, here);
        for (int q = 0; q < c->q; q++) {
            double j = deformed(c->k, gradient(c, m, q), here).j;
            if (!(j >= least)) least = j;
        }
    }
    return least;
}

/* What the volume change of the whole element adds to the pressure at every point. */
static inline double dilatation_pressure(const Cells *c, int m, const Deformation *d) {
    const double *weight = c->weight + (size_t)m * c->q;
    double area = 0, more = 0;
    for (int q = 0; q < c->q; q++) {
        area += weight[q];
        more += weight[q] * d[q].swelling;
    }
    return c->bulk[m] * more / area;
}

FAST void cell_forces(const Cells *c, const double *u, double *force, double *root) {
    double here[2 * MOST_NODES];
    Deformation d[MOST_POINTS];
    for (int m = 0; m < c->m; m++) {
        double *found = force + (size_t)m * 2 * c->k, pressure = 0;
        double bulk = c->law == MEAN_DILATATION ? 0 : c->bulk[m];
        local(c->nodes + (size_t)m * c->k, c->k, u, here);
        for (int q = 0; q < c->q; q++) d[q] = deformed(c->k, gradient(c, m, q), here);
        if (c->law == MEAN_DILATATION) pressure = dilatation_pressure(c, m, d);
        for (int a = 0; a < 2 * c->k; a++) found[a] = 0;
        for (int q = 0; q < c->q; q++) {
            const double *g = gradient(c, m, q);
            size_t point = (size_t)m * c->q + q;
            double stress[4], weight = c->weight[point];
            root[point] = c->law == PLANE_STRESS ? stress_free_root(d + q, c->shear[m], bulk)
                                                 : cbrt(d[q].j);
            Strained s = strained(c->law == PLANE_STRESS, d + q, root[point], c->shear[m], bulk);
            for (int v = 0; v < 4; v++)
                stress[v] = s.scale * d[q].f[v] + (pressure * d[q].j - s.turning) * d[q].h[v];
            for (int a = 0; a < c->k; a++) {
                found[2 * a] += weight * (stress[0] * g[a] + stress[1] * g[c->k + a]);
                found[2 * a + 1] += weight * (stress[2] * g[a] + stress[3] * g[c->k + a]);
            }
        }
    }
}

/* dP/dF (4, 4), but for the whole element's volume change; `pressure` turns with the body. */
static inline void find_moduli(int law, const Deformation *d, double root, double shear, double bulk,
                               double pressure, double moduli[4][4]) {
    Strained s = strained(law == PLANE_STRESS, d, root, shear, bulk);
    double of_h = s.scale * 2 / 9 * s.i1 + bulk * (2 * s.volume - 1) * s.volume + s.turning;
    double of_both = -2.0 / 3 * s.scale, of_f = 0;
    if (law == PLANE_STRESS) {
        Thinning t = thinning(d, &s, bulk);
        double soft = 1 / t.stiffness;
        of_h -= t.by_h * t.by_h * soft;
        of_both -= t.by_f * t.by_h * soft;
        of_f = -t.by_f * t.by_f * soft;
    }
    for (int v = 0; v < 4; v++) {
        double with_h = of_h * d->h[v] + of_both * d->f[v];
        double with_f = of_both * d->h[v] + of_f * d->f[v];
        for (int w = 0; w < 4; w++) moduli[v][w] = with_h * d->h[w] + with_f * d->f[w];
        moduli[v][v] += s.scale;
    }
    double twist = pressure - s.turning / d->j; /* of eps_ik eps_JL */
    moduli[0][3] += twist;
    moduli[1][2] -= twist;
    moduli[2][1] -= twist;
    moduli[3][0] += twist;
}

/* Gradients (q, 2, k) times moduli times gradients, for a number of nodes that the compiler knows. */
static inline void find_stiffness(int k, int points, const double *restrict g, const double *weight,
                                  double moduli[][4][4], double *restrict stiffness) {
    double moved[MOST_POINTS][4][2 * MOST_NODES];
    for (int q = 0; q < points; q++)
        for (int v = 0; v < 4; v++) {
            const double *x = g + 2 * q * k, *y = x + k;
            double *row = moved[q][v], by[4];
            for (int w = 0; w < 4; w++) by[w] = weight[q] * moduli[q][v][w];
            for (int b = 0; b < k; b++) {
                row[2 * b] = by[0] * x[b] + by[1] * y[b];
                row[2 * b + 1] = by[2] * x[b] + by[3] * y[b];
            }
        }
    for (int a = 0; a < k; a++)
        for (int i = 0; i < 2; i++) {
            double sum[2 * MOST_NODES] = {0}, *row = stiffness + (2 * a + i) * 2 * k;
            for (int q = 0; q < points; q++) {
                double x = g[2 * q * k + a], y = g[2 * q * k + k + a];
                for (int b = 0; b < 2 * k; b++)
                    sum[b] += x * moved[q][2 * i][b] + y * moved[q][2 * i + 1][b];
            }
            for (int b = 0; b < 2 * k; b++) row[b] = sum[b];
        }
}

/* Bulk modulus over area times how each displacement swells the element, with itself. */
static inline void add_swelling(const Cells *c, int m, const Deformation *d, double *stiffness) {
    double swell[2 * MOST_NODES] = {0}, area = 0;
    for (int q = 0; q < c->q; q++) {
        const double *g = gradient(c, m, q), *h = d[q].h;
        double weight = c->weight[(size_t)m * c->q + q], cofactor = weight * d[q].j;
        area += weight;
        for (int a = 0; a < c->k; a++) {
            swell[2 * a] += cofactor * (h[0] * g[a] + h[1] * g[c->k + a]);
            swell[2 * a + 1] += cofactor * (h[2] * g[a] + h[3] * g[c->k + a]);
        }
    }
    for (int a = 0; a < 2 * c->k; a++)
        for (int b = 0; b < 2 * c->k; b++)
            stiffness[2 * c->k * a + b] += c->bulk[m] / area * swell[a] * swell[b];
}

FAST void cell_tangents(const Cells *c, const double *u, const double *change,
                        const double *root, double *tangent) {
    double here[2 * MOST_NODES], step[2 * MOST_NODES], moduli[MOST_POINTS][4][4];
    Deformation d[MOST_POINTS];
    for (int m = 0; m < c->m; m++) {
        double *found = tangent + (size_t)m * 4 * c->k * c->k, lag[MOST_POINTS] = {0};
        double bulk = c->law == MEAN_DILATATION ? 0 : c->bulk[m], pressure = 0;
        local(c->nodes + (size_t)m * c->k, c->k, u, here);
        for (int q = 0; q < c->q; q++) d[q] = deformed(c->k, gradient(c, m, q), here);
        if (change) {
            local(c->nodes + (size_t)m * c->k, c->k, change, step);
            for (int q = 0; q < c->q; q++) {
                Deformation by = deformed(c->k, gradient(c, m, q), step);
                lag[q] = (by.f[0] - 1) * (by.f[3] - 1) - by.f[1] * by.f[2];
            }
        }
        const double *weight = c->weight + (size_t)m * c->q, *g = gradient(c, m, 0);
        if (c->law == MEAN_DILATATION) {
            double area = 0, late = 0;
            for (int q = 0; q < c->q; q++) {
                area += weight[q];
                late += weight[q] * lag[q];
            }
            pressure = dilatation_pressure(c, m, d) - c->bulk[m] * late / area;
        }
        for (int q = 0; q < c->q; q++) {
            double turned = c->law == PLANE_STRAIN ? -bulk * lag[q] : pressure;
            find_moduli(c->law, d + q, root[(size_t)m * c->q + q], c->shear[m], bulk, turned,
                        moduli[q]);
        }
        if (c->k == 6) find_stiffness(6, c->q, g, weight, moduli, found);
        else if (c->k == 4) find_stiffness(4, c->q, g, weight, moduli, found);
        else find_stiffness(8, c->q, g, weight, moduli, found);
        if (c->law == MEAN_DILATATION) add_swelling(c, m, d, found);
    }
}
