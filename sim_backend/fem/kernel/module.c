/* The kernel as a Python module, by the stable ABI: one build serves every Python from 3.11.

   Arrays come as contiguous buffers of float64, float32 and int64; what is found is written into
   arrays that the caller brings. */

#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include <stdlib.h>

#include "cells.h"
#include "fronts.h"
#include "solids.h"

enum { MOST_ARRAYS = 12 };

/* Buffers that are let go together. */
typedef struct {
    int count;
    Py_buffer view[MOST_ARRAYS];
} Views;

static void let_go(Views *views) {
    while (views->count) PyBuffer_Release(&views->view[--views->count]);
}

/* The next array: `count` numbers (any if negative) of `kind` d, f or q, to be written if `out`.
   NULL and an error if it is something else. */
static Py_buffer *take(Views *views, PyObject *from, char kind, Py_ssize_t count, int out) {
    Py_buffer *view = &views->view[views->count];
    if (PyObject_GetBuffer(from, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (out ? PyBUF_WRITABLE : 0)))
        return NULL;
    views->count++;
    char format = view->format ? view->format[0] : 'B';
    int right = kind == 'q' ? (format == 'l' || format == 'q') && view->itemsize == 8 : format == kind;
    if (right && (count < 0 || view->len == view->itemsize * count)) return view;
    PyErr_Format(PyExc_ValueError, "argument %d: want %zd numbers of kind %c, not %zd of kind %c",
                 views->count, count, kind, view->len / view->itemsize, format);
    return NULL;
}

static int arguments(Py_ssize_t given, Py_ssize_t wanted) {
    if (given == wanted) return 1;
    PyErr_Format(PyExc_TypeError, "%zd arguments, not %zd", wanted, given);
    return 0;
}

/* All of the numbers (count,) lie within displacements (n, 2)? */
static int within(const long long *nodes, Py_ssize_t count, Py_ssize_t n) {
    for (Py_ssize_t k = 0; k < count; k++)
        if (nodes[k] < 0 || nodes[k] >= n) {
            PyErr_SetString(PyExc_IndexError, "a cell has a node that is not there");
            return 0;
        }
    return 1;
}

#define TAKE(name, place, kind, count, out) \
    Py_buffer *name = take(&views, args[place], kind, count, out); \
    if (!name) goto end

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
    TAKE(sums, 2, 'd', -1, 1);
    if (!within(place->buf, place->len / 8, sums->len / 72)) goto end;
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

/* Fronts(size, groups, symmetric, free): `groups` a tuple of int64 (count, width) displacement
   numbers below `size`; `symmetric` a tuple of as many truths; `free` int64 (n,). */
typedef struct {
    PyObject_HEAD
    Fronts *fronts;
    int size, groups;
    int *count, *width;
} Planned;

static void planned_end(PyObject *self) {
    Planned *planned = (Planned *)self;
    PyTypeObject *type = Py_TYPE(self);
    if (planned->fronts) free_fronts(planned->fronts);
    free(planned->count);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(self);
    Py_DECREF(type);
}

static int read_groups(Planned *planned, PyObject *groups, Py_buffer *view, int *taken,
                       const long long **dofs) {
    for (int g = 0; g < planned->groups; g++) {
        Py_buffer *one = view + g;
        if (PyObject_GetBuffer(PyTuple_GetItem(groups, g), one, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT))
            return 0;
        ++*taken;
        if (one->ndim != 2 || one->itemsize != 8 || (one->format[0] != 'l' && one->format[0] != 'q')) {
            PyErr_SetString(PyExc_ValueError, "groups: want arrays of int64 with two dimensions");
            return 0;
        }
        planned->count[g] = (int)one->shape[0];
        planned->width[g] = (int)one->shape[1];
        dofs[g] = one->buf;
        if (!within(dofs[g], one->len / 8, planned->size)) return 0;
    }
    return 1;
}

static PyObject *planned_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    (void)keywords;
    int size, taken = 0;
    PyObject *groups, *symmetric, *free_dofs;
    if (!PyArg_ParseTuple(args, "iO!O!O", &size, &PyTuple_Type, &groups, &PyTuple_Type, &symmetric,
                          &free_dofs))
        return NULL;
    int count = (int)PyTuple_Size(groups);
    if (PyTuple_Size(symmetric) != count) {
        PyErr_SetString(PyExc_ValueError, "symmetric: want one truth a group");
        return NULL;
    }
    Planned *planned = (Planned *)((allocfunc)PyType_GetSlot(type, Py_tp_alloc))(type, 0);
    Views views = {0};
    Py_buffer *view = calloc((size_t)count + 1, sizeof(Py_buffer));
    const long long **dofs = calloc((size_t)count + 1, sizeof(long long *));
    int *same = calloc((size_t)count + 1, sizeof(int));
    int *numbers = planned ? calloc(2 * (size_t)count + 1, sizeof(int)) : NULL;
    if (!view || !dofs || !same || !numbers) {
        PyErr_NoMemory();
        goto end;
    }
    planned->size = size;
    planned->groups = count;
    planned->count = numbers;
    planned->width = numbers + count;
    Py_buffer *unknown = take(&views, free_dofs, 'q', -1, 0);
    if (!unknown || !within(unknown->buf, unknown->len / 8, size)) goto end;
    if (!read_groups(planned, groups, view, &taken, dofs)) goto end;
    for (int g = 0; g < count; g++) same[g] = PyObject_IsTrue(PyTuple_GetItem(symmetric, g));
    Groups all = {count, planned->count, planned->width, same, dofs};
    planned->fronts = plan_fronts(size, all, (int)(unknown->len / 8), unknown->buf);
    if (!planned->fronts) PyErr_NoMemory();
end:
    while (taken) PyBuffer_Release(&view[--taken]);
    let_go(&views);
    free(view);
    free(dofs);
    free(same);
    if (!PyErr_Occurred()) return (PyObject *)planned;
    Py_XDECREF((PyObject *)planned);
    return NULL;
}

/* factor(matrices): how many pivots are negative, -1 if one is none. */
static PyObject *planned_factor(PyObject *self, PyObject *matrices) {
    Planned *planned = (Planned *)self;
    if (!PyTuple_Check(matrices) || PyTuple_Size(matrices) != planned->groups) {
        PyErr_SetString(PyExc_ValueError, "matrices: want a tuple of one array a group");
        return NULL;
    }
    Py_buffer *view = calloc((size_t)planned->groups + 1, sizeof(Py_buffer));
    const double **data = calloc((size_t)planned->groups + 1, sizeof(double *));
    PyObject *result = NULL;
    int taken = 0;
    if (!view || !data) PyErr_NoMemory();
    for (int g = 0; !PyErr_Occurred() && g < planned->groups; g++) {
        Views one = {0};
        Py_ssize_t width = planned->width[g];
        if (!take(&one, PyTuple_GetItem(matrices, g), 'd', planned->count[g] * width * width, 0))
            let_go(&one);
        else view[taken++] = one.view[0], data[g] = view[g].buf;
    }
    if (!PyErr_Occurred()) {
        int whole = factor_fronts(planned->fronts, planned->width, data);
        result = PyLong_FromLong(whole ? planned->fronts->negative : -1);
    }
    while (taken) PyBuffer_Release(&view[--taken]);
    free(view);
    free(data);
    return result;
}

/* solve(force, x): displacements x (size,) under a force (size,), by the last factors. */
static PyObject *planned_solve(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    Planned *planned = (Planned *)self;
    Views views = {0};
    PyObject *result = NULL;
    if (!arguments(given, 2)) return NULL;
    TAKE(force, 0, 'd', planned->size, 0);
    TAKE(x, 1, 'd', planned->size, 1);
    solve_fronts(planned->fronts, force->buf, x->buf);
    result = Py_NewRef(Py_None);
end:
    let_go(&views);
    return result;
}

static PyMethodDef planned_methods[] = {
    {"factor", planned_factor, METH_O, NULL}, 
    {"solve", (PyCFunction)(void (*)(void))planned_solve, METH_FASTCALL, NULL}, {0}};

static PyType_Slot planned_slots[] = {{Py_tp_new, planned_new},
                                      {Py_tp_dealloc, planned_end},
                                      {Py_tp_methods, planned_methods},
                                      {0, NULL}};

static PyType_Spec planned_spec = {"sim_backend.fem.kernel._kernel.Fronts", sizeof(Planned), 0,
                                   Py_TPFLAGS_DEFAULT, planned_slots};

static PyMethodDef functions[] = {
    {"cell_forces", (PyCFunction)(void (*)(void))forces, METH_FASTCALL, NULL},
    {"cell_tangents", (PyCFunction)(void (*)(void))tangents, METH_FASTCALL, NULL},
    {"least_area_ratio", (PyCFunction)(void (*)(void))area_ratio, METH_FASTCALL, NULL},
    {"unit_pressure", (PyCFunction)(void (*)(void))lumen, METH_FASTCALL, NULL},
    {"wedge_tangents", (PyCFunction)(void (*)(void))wedges, METH_FASTCALL, NULL},
    {"join_blocks", (PyCFunction)(void (*)(void))joined, METH_FASTCALL, NULL},
    {"extend_front", (PyCFunction)(void (*)(void))extended, METH_FASTCALL, NULL},
    {"front_down", (PyCFunction)(void (*)(void))down, METH_FASTCALL, NULL},
    {"front_up", (PyCFunction)(void (*)(void))up, METH_FASTCALL, NULL},
    {0}};

static int fill(PyObject *module) {
    PyObject *type = PyType_FromModuleAndSpec(module, &planned_spec, NULL);
    int failed = !type || PyModule_AddObjectRef(module, "Fronts", type);
    Py_XDECREF(type);
    return failed ? -1 : 0;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, fill}, {0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_kernel", NULL, 0, functions, slots,
                                        NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&definition); }
