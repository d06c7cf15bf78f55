/* The material of sim_backend/fem/material.py at one point, by its formulas and names. */

#ifndef MATERIAL_H
#define MATERIAL_H

#include <math.h>

/* F as [F11, F12, F21, F22], F^-T, det F in the plane, and det F - 1 without the rounding of 1. */
typedef struct {
    double f[4], h[4], j, swelling;
} Deformation;

/* The cube root of J, J itself, the thickness l3, I1, G J^(-2/3), and what F^-T is taken by. */
typedef struct {
    double volume, l3, i1, scale, turning;
} Strained;

static inline void local(const long long *nodes, int k, const double *u, double *found) {
    for (int a = 0; a < k; a++) {
        found[2 * a] = u[2 * nodes[a]];
        found[2 * a + 1] = u[2 * nodes[a] + 1];
    }
}

/* Of displacements `u` (k, 2) with `gradient` (2, k). */
static inline Deformation deformed(int k, const double *gradient, const double *u) {
    Deformation d = {.f = {0}};
    for (int a = 0; a < k; a++) {
        d.f[0] += u[2 * a] * gradient[a];
        d.f[1] += u[2 * a] * gradient[k + a];
        d.f[2] += u[2 * a + 1] * gradient[a];
        d.f[3] += u[2 * a + 1] * gradient[k + a];
    }
    d.swelling = d.f[0] + d.f[3] + (d.f[0] * d.f[3] - d.f[1] * d.f[2]);
    d.f[0] += 1;
    d.f[3] += 1;
    d.j = d.f[0] * d.f[3] - d.f[1] * d.f[2];
    double inverse = 1 / d.j;
    d.h[0] = d.f[3] * inverse;
    d.h[1] = -d.f[2] * inverse;
    d.h[2] = -d.f[1] * inverse;
    d.h[3] = d.f[0] * inverse;
    return d;
}

static inline double in_plane(const Deformation *d) {
    return d->f[0] * d->f[0] + d->f[1] * d->f[1] + d->f[2] * d->f[2] + d->f[3] * d->f[3];
}

/* The cube root of J at which P33 = 0: `_stress_free_root`. */
static inline double stress_free_root(const Deformation *d, double shear, double bulk) {
    double root = 1, out = 2 * shear / (d->j * d->j), back = shear * in_plane(d);
    for (int sweep = 0; sweep < 40; sweep++) {
        double inverse = 1 / root, square = inverse * inverse;
        double fifth = square * square * inverse * back;
        double change = (out * root - fifth + 3 * bulk * (root * root * root - 1)) /
                        (out + 5 * fifth * inverse + 9 * bulk * root * root);
        root = root - change > 0.5 * root ? root - change : 0.5 * root;
        if (fabs(change) < 1e-8 * root) break;
    }
    return root;
}

/* Where the section is `free` to thin, P33 = 0 gives what F^-T is taken by: `plane_stress`. */
static inline Strained strained(int free, const Deformation *d, double root, double shear,
                                double bulk) {
    Strained s;
    s.volume = root * root * root;
    s.l3 = s.volume / d->j;
    s.i1 = in_plane(d) + s.l3 * s.l3;
    s.scale = shear / (root * root);
    s.turning = free ? s.scale * s.l3 * s.l3
                     : s.scale * s.i1 / 3 - bulk * d->swelling * s.volume;
    return s;
}

/* a = dP/dl3 = by_f F + by_h F^-T over m = dP33/dl3. */
typedef struct {
    double by_f, by_h, stiffness;
} Thinning;

static inline Thinning thinning(const Deformation *d, const Strained *s, double bulk) {
    double inverse = 1 / s->l3, back = s->i1 * inverse / 3, q = s->l3 - back;
    return (Thinning){
        -2.0 / 3 * s->scale * inverse,
        (s->scale * (2.0 / 9 * s->i1 - 2.0 / 3 * s->l3 * s->l3) +
         bulk * (2 * s->volume - 1) * s->volume) * inverse,
        s->scale * (-2.0 / 3 * q * inverse + 1.0 / 3 + back * inverse) + bulk * d->j * d->j};
}

#endif
