/* Force of a pressure of 1 Pa in a lumen, and its tangent: sim_backend/fem/lumen.py. */

#include <stddef.h>
#include <string.h>

#include "cells.h"
#include "material.h"

enum { MOST_NODES = 8 };

FAST void unit_pressure(const Sides *sides, const double *u, double *force, double *tangent) {
    int k = sides->k, d = 2 * k;
    memset(force, 0, sizeof(double) * (size_t)(sides->s * d));
    memset(tangent, 0, sizeof(double) * (size_t)(sides->s * d) * (size_t)d);
    for (int s = 0; s < sides->s; s++) {
        double here[2 * MOST_NODES], slimmer[2 * MOST_NODES] = {0};
        double *pushed = force + (size_t)s * d, *turned = tangent + (size_t)s * d * d;
        const double *place = sides->place + (size_t)s * d;
        local(sides->nodes + (size_t)s * k, k, u, here);
        for (int q = 0; q < sides->q; q++) {
            const double *g = sides->gradient + ((size_t)s * sides->q + q) * 2 * k;
            const double *spread = sides->spread + q * k, *along = sides->along + q * k;
            double x = 0, y = 0, l3 = 1;
            for (int a = 0; a < k; a++) {
                x += along[a] * (place[2 * a] + here[2 * a]);
                y += along[a] * (place[2 * a + 1] + here[2 * a + 1]);
            }
            if (sides->free) {
                Deformation f = deformed(k, g, here);
                double root = stress_free_root(&f, sides->shear[s], sides->bulk[s]), by[4];
                Strained strain = strained(1, &f, root, sides->shear[s], sides->bulk[s]);
                Thinning t = thinning(&f, &strain, sides->bulk[s]);
                l3 = strain.l3;
                for (int v = 0; v < 4; v++)
                    by[v] = -(t.by_f * f.f[v] + t.by_h * f.h[v]) / t.stiffness;
                for (int b = 0; b < k; b++) {
                    slimmer[2 * b] = by[0] * g[b] + by[1] * g[k + b];
                    slimmer[2 * b + 1] = by[2] * g[b] + by[3] * g[k + b];
                }
            }
            for (int a = 0; a < k; a++) {
                if (spread[a] == 0) continue;
                double across[2] = {-y * spread[a], x * spread[a]};
                for (int i = 0; i < 2; i++) {
                    double *row = turned + (2 * a + i) * d;
                    pushed[2 * a + i] += l3 * across[i];
                    for (int b = 0; b < d; b++) row[b] += across[i] * slimmer[b];
                    for (int b = 0; b < k; b++)
                        row[2 * b + 1 - i] += (i ? l3 : -l3) * spread[a] * along[b];
                }
            }
        }
    }
}
