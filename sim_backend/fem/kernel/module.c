/* The kernel as a Python module: what is found is written into arrays that the caller brings. */

#include "arguments.h"
#include "cells.h"
#include "fronts_type.h"
#include "solids.h"

/* Arguments 0 to 5: u, nodes, gradient, weight, shear, bulk; 6: the law. */
static int take_cells(Views *views, PyObject *const *args, Cells *cells, const double **u) {
    Py_buffer *moved = take(views, args[0], 'd', -1, 0);
    Py_buffer *nodes = moved ? take(views, args[1], 'q', -1, 0) : NULL;
    Py_buffer *weight = nodes ? take(views, args[3], 'd', -1, 0) : NULL;
    if (!weight) return 0;
    if (nodes->ndim != 2 || weight->ndim != 2 || nodes->shape[0] != weight->shape[0]) {
        PyErr_SetString(PyExc_ValueError, "nodes and weight: want two dimensions, the first alike");
        return 0;
    }
    cells->m = (int)nodes->shape[0];
    cells->k = (int)nodes->shape[1];
    cells->q = (int)weight->shape[1];
    cells->law = (int)PyLong_AsLong(args[6]);
    if (PyErr_Occurred()) return 0;
    if ((cells->k != 4 && cells->k != 6 && cells->k != 8) || cells->q > 4) {
        PyErr_SetString(PyExc_ValueError, "want cells of 4, 6 or 8 nodes with at most 4 points");
        return 0;
    }
    Py_ssize_t points = (Py_ssize_t)cells->m * cells->q;
    Py_buffer *gradient = take(views, args[2], 'd', 2 * points * cells->k, 0);
    Py_buffer *shear = gradient ? take(views, args[4], 'd', cells->m, 0) : NULL;
    Py_buffer *bulk = shear ? take(views, args[5], 'd', cells->m, 0) : NULL;
    if (!bulk || !within(nodes->buf, (Py_ssize_t)cells->m * cells->k, moved->len / 16)) return 0;
    cells->nodes = nodes->buf;
    cells->gradient = gradient->buf;
    cells->weight = weight->buf;
    cells->shear = shear->buf;
    cells->bulk = bulk->buf;
    *u = moved->buf;
    return 1;
}

static PyObject *forces(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    Cells cells;
    const double *u;
    PyObject *result = NULL;
    if (!arguments(given, 9) || !take_cells(&views, args, &cells, &u)) goto end;
    TAKE(force, 7, 'd', (Py_ssize_t)cells.m * 2 * cells.k, 1);
    TAKE(thickness, 8, 'd', (Py_ssize_t)cells.m * cells.q, 1);
    cell_forces(&cells, u, force->buf, thickness->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyObject *tangents(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    Cells cells;
    const double *u;
    PyObject *result = NULL;
    if (!arguments(given, 10) || !take_cells(&views, args, &cells, &u)) goto end;
    TAKE(thickness, 7, 'd', (Py_ssize_t)cells.m * cells.q, 0);
    TAKE(tangent, 8, 'd', (Py_ssize_t)cells.m * 4 * cells.k * cells.k, 1);
    const double *change = NULL;
    if (args[9] != Py_None) {
        TAKE(step, 9, 'd', views.view[0].len / 8, 0);
        change = step->buf;
    }
    cell_tangents(&cells, u, change, thickness->buf, tangent->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyObject *area_ratio(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    Cells cells;
    const double *u;
    PyObject *result = NULL;
    if (arguments(given, 7) && take_cells(&views, args, &cells, &u))
        result = PyFloat_FromDouble(least_area_ratio(&cells, u));
    let_go(&views);
    return result;
}

static PyObject *lumen(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    PyObject *result = NULL;
    if (!arguments(given, 11)) return NULL;
    TAKE(u, 0, 'd', -1, 0);
    TAKE(nodes, 1, 'q', -1, 0);
    TAKE(spread, 3, 'd', -1, 0);
    Sides sides = {.free = PyObject_IsTrue(args[8])};
    if (nodes->ndim != 2 || spread->ndim != 2 || spread->shape[1] != nodes->shape[1] ||
        nodes->shape[1] > 8) {
        PyErr_SetString(PyExc_ValueError, "nodes and spread: want at most 8 nodes in both");
        goto end;
    }
    sides.s = (int)nodes->shape[0];
    sides.k = (int)nodes->shape[1];
    sides.q = (int)spread->shape[0];
    Py_ssize_t all = (Py_ssize_t)sides.s * 2 * sides.k;
    TAKE(place, 2, 'd', all, 0);
    TAKE(along, 4, 'd', (Py_ssize_t)sides.q * sides.k, 0);
    TAKE(gradient, 5, 'd', all * sides.q, 0);
    TAKE(shear, 6, 'd', sides.s, 0);
    TAKE(bulk, 7, 'd', sides.s, 0);
    TAKE(force, 9, 'd', all, 1);
    TAKE(tangent, 10, 'd', all * 2 * sides.k, 1);
    if (!within(nodes->buf, (Py_ssize_t)sides.s * sides.k, u->len / 16)) goto end;
    sides.nodes = nodes->buf;
    sides.place = place->buf;
    sides.spread = spread->buf;
    sides.along = along->buf;
    sides.gradient = gradient->buf;
    sides.shear = shear->buf;
    sides.bulk = bulk->buf;
    unit_pressure(&sides, u->buf, force->buf, tangent->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyObject *wedges(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    PyObject *result = NULL;
    if (!arguments(given, 5)) return NULL;
    TAKE(slopes, 3, 'd', -1, 0);
    if (slopes->ndim != 3 || slopes->shape[2] != 4) {
        PyErr_SetString(PyExc_ValueError, "slopes: want (m, points, 4)");
        goto end;
    }
    Py_ssize_t m = slopes->shape[0], points = slopes->shape[1];
    TAKE(gradient, 0, 'd', m * points * WEDGE_NODES * 3, 0);
    TAKE(f, 1, 'd', m * points * 9, 0);
    TAKE(h, 2, 'd', m * points * 9, 0);
    TAKE(tangents, 4, 'f', m * 9 * WEDGE_NODES * WEDGE_NODES, 1);
    wedge_tangents(gradient->buf, f->buf, h->buf, slopes->buf, (int)m, (int)points, tangents->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyObject *joined(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    PyObject *result = NULL;
    if (!arguments(given, 3)) return NULL;
    TAKE(place, 1, 'q', -1, 0);
    if (place->ndim != 3 || place->shape[1] != place->shape[2]) {
        PyErr_SetString(PyExc_ValueError, "place: want as many rows as columns of each element");
        goto end;
    }
    TAKE(blocks, 0, 'f', place->len / 8 * 9, 0);
    TAKE(sums, 2, 'f', -1, 1);
    if (!within(place->buf, place->len / 8, sums->len / 36)) goto end;
    join_blocks(blocks->buf, (int)place->shape[0], (int)place->shape[1], place->buf, sums->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyObject *extended(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    PyObject *result = NULL;
    if (!arguments(given, 4)) return NULL;
    TAKE(at, 1, 'q', -1, 0);
    Py_ssize_t border = at->len / 8;
    TAKE(update, 0, 'f', 9 * border * border, 0);
    TAKE(top, 2, 'f', -1, 1);
    TAKE(rest, 3, 'f', -1, 1);
    if (top->ndim != 2 || rest->ndim != 2 || rest->shape[0] != rest->shape[1] ||
        top->shape[0] != top->shape[1] + rest->shape[0] || top->shape[1] % 3 || rest->shape[0] % 3) {
        PyErr_SetString(PyExc_ValueError, "top and rest: want the columns of one front");
        goto end;
    }
    const long long *nodes = at->buf;
    if (!within(nodes, border, top->shape[0] / 3)) goto end;
    for (Py_ssize_t b = 1; b < border; b++)
        if (nodes[b] <= nodes[b - 1]) {
            PyErr_SetString(PyExc_ValueError, "at: want nodes that grow");
            goto end;
        }
    extend_front(update->buf, (int)border, nodes, top->buf, (int)top->shape[1], rest->buf,
                 (int)rest->shape[0]);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

/* Arguments: root, coupled, border, own, x. */
static PyObject *substituted(PyObject *const *args, Py_ssize_t given,
                             void (*substitute)(const float *, const float *, int, const long long *,
                                                int, float *, float *)) {
    Views views = {0};
    PyObject *result = NULL;
    if (!arguments(given, 5)) return NULL;
    TAKE(border, 2, 'q', -1, 0);
    TAKE(own, 3, 'f', -1, 1);
    Py_ssize_t pivots = own->len / 4, beyond = border->len / 8;
    TAKE(root, 0, 'f', pivots * pivots, 0);
    TAKE(coupled, 1, 'f', pivots * beyond, 0);
    TAKE(x, 4, 'f', -1, 1);
    if (!within(border->buf, beyond, x->len / 4)) goto end;
    substitute(root->buf, coupled->buf, (int)pivots, border->buf, (int)beyond, own->buf, x->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyObject *down(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    return substituted(args, given, front_down);
}

static PyObject *up(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    return substituted(args, given, front_up);
}

/* Arguments: blocks, columns, starts, x, y. */
static PyObject *product(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    (void)self;
    Views views = {0};
    PyObject *result = NULL;
    if (!arguments(given, 5)) return NULL;
    TAKE(columns, 1, 'q', -1, 0);
    TAKE(starts, 2, 'q', -1, 0);
    Py_ssize_t count = columns->len / 8, rows = starts->len / 8 - 1;
    TAKE(blocks, 0, 'f', 9 * count, 0);
    TAKE(x, 3, 'f', 3 * rows, 0);
    TAKE(y, 4, 'f', 3 * rows, 1);
    if (!within(columns->buf, count, rows) || !within(starts->buf, rows + 1, count + 1)) goto end;
    block_product(blocks->buf, columns->buf, starts->buf, (int)rows, x->buf, y->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyMethodDef functions[] = {
    {"cell_forces", (PyCFunction)(void (*)(void))forces, METH_FASTCALL, NULL},
    {"cell_tangents", (PyCFunction)(void (*)(void))tangents, METH_FASTCALL, NULL},
    {"least_area_ratio", (PyCFunction)(void (*)(void))area_ratio, METH_FASTCALL, NULL},
    {"unit_pressure", (PyCFunction)(void (*)(void))lumen, METH_FASTCALL, NULL},
    {"wedge_tangents", (PyCFunction)(void (*)(void))wedges, METH_FASTCALL, NULL},
    {"join_blocks", (PyCFunction)(void (*)(void))joined, METH_FASTCALL, NULL},
    {"block_product", (PyCFunction)(void (*)(void))product, METH_FASTCALL, NULL},
    {"extend_front", (PyCFunction)(void (*)(void))extended, METH_FASTCALL, NULL},
    {"front_down", (PyCFunction)(void (*)(void))down, METH_FASTCALL, NULL},
    {"front_up", (PyCFunction)(void (*)(void))up, METH_FASTCALL, NULL},
    {0}};

static int fill(PyObject *module) {
    PyObject *type = PyType_FromModuleAndSpec(module, &fronts_spec, NULL);
    int failed = !type || PyModule_AddObjectRef(module, "Fronts", type);
    Py_XDECREF(type);
    return failed ? -1 : 0;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, fill}, {0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_kernel", NULL, 0, functions, slots,
                                        NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&definition); }
