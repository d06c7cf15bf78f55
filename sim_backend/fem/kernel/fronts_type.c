#include "fronts_type.h"

#include <stdlib.h>

#include "fronts.h"

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

PyType_Spec fronts_spec = {"sim_backend.fem.kernel._kernel.Fronts", sizeof(Planned), 0,
                           Py_TPFLAGS_DEFAULT, planned_slots};
