#include "arguments.h"

void let_go(Views *views) {
    while (views->count) PyBuffer_Release(&views->view[--views->count]);
}

Py_buffer *take(Views *views, PyObject *from, char kind, Py_ssize_t count, int out) {
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

int arguments(Py_ssize_t given, Py_ssize_t wanted) {
    if (given == wanted) return 1;
    PyErr_Format(PyExc_TypeError, "%zd arguments, not %zd", wanted, given);
    return 0;
}

int within(const long long *nodes, Py_ssize_t count, Py_ssize_t n) {
    for (Py_ssize_t k = 0; k < count; k++)
        if (nodes[k] < 0 || nodes[k] >= n) {
            PyErr_SetString(PyExc_IndexError, "a number points beyond its array");
            return 0;
        }
    return 1;
}
