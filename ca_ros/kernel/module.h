/* What the Python modules of the library share: their names, and the reading of buffers. */
#ifndef CA_ROS_KERNEL_MODULE_H
#define CA_ROS_KERNEL_MODULE_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <string.h>

#include "problem.h"

/* The name of the module comes from setup.py. */
#define TEXT(name) #name
#define TEXT_OF(name) TEXT(name)
#define JOIN(a, b) a##b
#define JOIN_OF(a, b) JOIN(a, b)
#define NAME TEXT_OF(CA_MODULE)
#define INIT JOIN_OF(PyInit_, CA_MODULE)

#define METHOD(name, flags, text) {#name, (PyCFunction)(void (*)(void))name, flags, text}

#ifdef CA_FLOAT
#define FORMAT 'f'
#else
#define FORMAT 'd'
#endif

/* Get a contiguous buffer of `count` numbers, or of a multiple of it if `rows` is given. */
static inline int get(PyObject *object, Py_buffer *view, char format, Py_ssize_t count,
                      Py_ssize_t *rows, int writable)
{
    const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
    if (PyObject_GetBuffer(object, view, flags) < 0)
        return 0;
    const Py_ssize_t numbers = view->itemsize ? view->len / view->itemsize : 0;
    const int fits = rows ? numbers % count == 0 && (*rows < 0 || numbers / count == *rows)
                          : numbers == count && view->ndim == 1;
    if (view->format[0] != format || view->format[1] || !fits) {
        PyBuffer_Release(view);
        PyErr_Format(PyExc_TypeError, "expected a contiguous array of %zd numbers of type '%c'",
                     count, format);
        return 0;
    }
    if (rows)
        *rows = numbers / count;
    return 1;
}

/* Get a buffer for each of `count` arguments. On failure none is held. */
static inline int get_all(PyObject *const *arguments, int count, Py_buffer *views,
                          const char *formats, const Py_ssize_t *widths, Py_ssize_t *rows,
                          int first_writable)
{
    for (int i = 0; i < count; i++)
        if (!get(arguments[i], &views[i], formats[i], widths[i], rows, i >= first_writable)) {
            while (i)
                PyBuffer_Release(&views[--i]);
            return 0;
        }
    return 1;
}

static inline void release(int count, Py_buffer *views)
{
    while (count)
        PyBuffer_Release(&views[--count]);
}

/* What `allocate` returns: None for an exact answer, else (status, level). */
static inline PyObject *answer_of(int status, ca_real level)
{
    if (status == 0)
        Py_RETURN_NONE;
    PyObject *parts[2] = {PyLong_FromLong(status), PyFloat_FromDouble((double)level)};
    PyObject *answer = parts[0] && parts[1] ? PyTuple_Pack(2, parts[0], parts[1]) : NULL;
    Py_XDECREF(parts[0]);
    Py_XDECREF(parts[1]);
    return answer;
}

/* Copy numbers of either precision, adjacent or not, to numbers of the library's type. */
static inline int copy_from(PyObject *array, Py_ssize_t count, ca_real *numbers)
{
    Py_buffer view;
    if (PyObject_GetBuffer(array, &view, PyBUF_STRIDES | PyBUF_FORMAT) < 0)
        return 0;
    const int whole = strcmp(view.format, "d") == 0;
    const int fits = view.ndim == 1 && view.shape[0] == count &&
                     (whole || strcmp(view.format, "f") == 0);
    const char *from = view.buf;
    for (Py_ssize_t i = 0; fits && i < count; i++, from += view.strides[0])
        numbers[i] = whole ? (ca_real)*(const double *)from : (ca_real)*(const float *)from;
    PyBuffer_Release(&view);
    if (!fits)
        PyErr_Format(PyExc_TypeError, "expected an array of %zd floating-point numbers", count);
    return fits;
}

/* Return a new module with one type and the greatest numbers of rotors and axes, or NULL. */
static PyObject *module_of(PyModuleDef *definition, PyTypeObject *type)
{
    PyObject *self = PyModule_Create(definition);
    if (self && (PyModule_AddType(self, type) < 0 || PyModule_AddIntConstant(self, "N", CA_N) < 0 ||
                 PyModule_AddIntConstant(self, "M", CA_M) < 0))
        Py_CLEAR(self);
    return self;
}

#endif
