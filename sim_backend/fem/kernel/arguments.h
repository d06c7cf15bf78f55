/* What Python gives to a function of the kernel, by the stable ABI: one build serves every Python
   from 3.11. Arrays come as contiguous buffers of float64, float32 and int64. */

#ifndef ARGUMENTS_H
#define ARGUMENTS_H

#define Py_LIMITED_API 0x030B0000
#include <Python.h>

enum { MOST_ARRAYS = 12 };

/* Buffers that are let go together. */
typedef struct {
    int count;
    Py_buffer view[MOST_ARRAYS];
} Views;

#ifdef __GNUC__
#pragma GCC visibility push(hidden)
#endif

void let_go(Views *views);

/* The next array: `count` numbers (any if negative) of `kind` d, f or q, to be written if `out`.
   NULL and an error if it is something else. */
Py_buffer *take(Views *views, PyObject *from, char kind, Py_ssize_t count, int out);

/* As many arguments as are wanted? */
int arguments(Py_ssize_t given, Py_ssize_t wanted);

/* All of the numbers (count,) are from 0 to below n? */
int within(const long long *nodes, Py_ssize_t count, Py_ssize_t n);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif

#define TAKE(name, place, kind, count, out) \
    Py_buffer *name = take(&views, args[place], kind, count, out); \
    if (!name) goto end

#endif
