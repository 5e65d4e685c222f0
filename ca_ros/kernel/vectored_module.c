/* The allocator of vectors in convex sets as a Python module. */
#include "module.h"

#include "vectored.h"
#include "vectored_newton.h"
#include "vectored_priorities.h"

typedef struct {
    PyObject_HEAD
    ca_vectored problem;
} object;

static int axes(const object *self)
{
    return (int)self->problem.axes;
}

static int components(const object *self)
{
    return (int)self->problem.components;
}

typedef void (*method)(const ca_vectored *, const ca_real *, ca_real *, ca_vectored_answer *);

/* Whether `__init__` has set up a problem, and there are as many arguments as expected. */
static int ready(const object *self, Py_ssize_t count, Py_ssize_t expected)
{
    if (components(self) && count == expected)
        return 1;
    PyErr_Format(PyExc_TypeError, "expected a problem and %zd arguments, got %zd", expected, count);
    return 0;
}

/* Write vectors, status, levels and multipliers for each of the wrenches. */
static PyObject *each_of(const object *self, PyObject *const *arguments, Py_ssize_t count,
                         method answers)
{
    const Py_ssize_t m = axes(self), n = components(self), widths[5] = {m, n, 1, 1, m};
    const char formats[5] = {FORMAT, FORMAT, 'b', FORMAT, FORMAT};
    Py_buffer views[5];
    Py_ssize_t rows = -1;
    if (!ready(self, count, 5))
        return NULL;
    const int given = arguments[4] == Py_None ? 4 : 5;
    if (!get_all(arguments, given, views, formats, widths, &rows, 1))
        return NULL;
    Py_BEGIN_ALLOW_THREADS
    for (Py_ssize_t i = 0; i < rows; i++) {
        ca_vectored_answer answer;
        answers(&self->problem, (const ca_real *)views[0].buf + i * m,
                (ca_real *)views[1].buf + i * n, &answer);
        ((signed char *)views[2].buf)[i] =
            (signed char)(answers == ca_vectored_solve && answer.unattainable ? -1 : answer.status);
        ((ca_real *)views[3].buf)[i] = answer.level;
        for (Py_ssize_t k = 0; given == 5 && k < m; k++)
            ((ca_real *)views[4].buf)[i * m + k] = answer.y[k];
    }
    Py_END_ALLOW_THREADS
    release(given, views);
    Py_RETURN_NONE;
}

static PyObject *allocate_batch(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    return each_of(self, arguments, count, ca_vectored_allocate);
}

static PyObject *solve_batch(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    return each_of(self, arguments, count, ca_vectored_solve);
}

static PyObject *allocate(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    const char formats[2] = {FORMAT, FORMAT};
    const Py_ssize_t widths[2] = {axes(self), components(self)};
    Py_buffer views[2];
    ca_vectored_answer answer = {0};
    if (!ready(self, count, 3))
        return NULL;
    if (!get_all(arguments + 1, 2, views, formats, widths, NULL, 0))
        return NULL;
    const int copied = copy_from(arguments[0], axes(self), views[0].buf);
    if (copied)
        ca_vectored_allocate(&self->problem, views[0].buf, views[1].buf, &answer);
    release(2, views);
    return copied ? answer_of(answer.status, answer.level) : NULL;
}

static PyObject *line(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    const char formats[4] = {FORMAT, FORMAT, FORMAT, FORMAT};
    const Py_ssize_t widths[4] = {axes(self), axes(self), components(self), axes(self)};
    Py_buffer views[4];
    ca_vectored_answer answer;
    if (!ready(self, count, 5))
        return NULL;
    const double end = PyFloat_AsDouble(arguments[4]);
    if (PyErr_Occurred() || !get_all(arguments, 4, views, formats, widths, NULL, 2))
        return NULL;
    ca_vectored_line(&self->problem, views[0].buf, views[1].buf, (ca_real)end, views[2].buf,
                     &answer);
    for (int k = 0; k < axes(self); k++)
        ((ca_real *)views[3].buf)[k] = answer.y[k];
    release(4, views);
    return Py_BuildValue("(dd)", (double)answer.level, (double)answer.most);
}

static PyObject *prioritize(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    const char formats[2] = {FORMAT, FORMAT};
    const Py_ssize_t widths[2] = {axes(self), components(self)};
    Py_buffer views[2];
    ca_vectored_answer answer = {0};
    if (!ready(self, count, 2))
        return NULL;
    if (!get_all(arguments, 2, views, formats, widths, NULL, 1))
        return NULL;
    const ca_real share =
        ca_vectored_prioritize(&self->problem, views[0].buf, views[1].buf, &answer);
    release(2, views);
    return PyFloat_FromDouble((double)share);
}

static PyObject *command(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    const int sets = (int)self->problem.sets;
    const char formats[9] = {FORMAT, FORMAT, FORMAT, 'i', FORMAT, FORMAT, FORMAT, FORMAT, FORMAT};
    Py_ssize_t widths[9] = {components(self), sets, sets, sets, 0, 0, 0, sets, 0};
    Py_buffer views[9];
    if (!ready(self, count, 9))
        return NULL;
    const Py_ssize_t servos = PyObject_Length(arguments[4]);
    widths[4] = widths[5] = widths[6] = widths[8] = servos;
    if (servos < 0 || !get_all(arguments, 9, views, formats, widths, NULL, 7))
        return NULL;
    Py_ssize_t sum = 0;
    for (int i = 0; i < sets; i++)
        sum += ((const int *)views[3].buf)[i];
    if (sum == servos)
        ca_vectored_command(&self->problem, views[0].buf, views[1].buf, views[2].buf, views[3].buf,
                            views[4].buf, views[5].buf, views[6].buf, views[7].buf, views[8].buf);
    release(9, views);
    if (sum != servos) {
        PyErr_SetString(PyExc_ValueError, "servos: expected as many as there are angles");
        return NULL;
    }
    Py_RETURN_NONE;
}

static int initialise(object *self, PyObject *arguments, PyObject *keywords)
{
    PyObject *array;
    ca_vectored problem;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O", &array) ||
        !copy_from(array, (int)(sizeof problem / sizeof(ca_real)), (ca_real *)&problem))
        return -1;
    ca_real sum = 0;
    for (int i = 0; i < CA_N && i < (int)problem.sets; i++)
        sum += problem.size[i];
    if (!(problem.components >= 1 && problem.components <= CA_N && problem.axes >= 1 &&
          problem.axes <= CA_M && (int)sum == (int)problem.components)) {
        PyErr_Format(PyExc_ValueError, "expected 1 to %d components and 1 to %d axes", CA_N, CA_M);
        return -1;
    }
    self->problem = problem;
    return 0;
}

static PyMethodDef methods[] = {
    METHOD(allocate, METH_FASTCALL,
           "allocate(u, vectors): return None if exact, else (status, level, steps, 0)"),
    METHOD(allocate_batch, METH_FASTCALL,
           "allocate_batch(wrenches, vectors, status, levels, multipliers or None)"),
    METHOD(solve_batch, METH_FASTCALL,
           "solve_batch(wrenches, vectors, status, levels, multipliers or None): the least cost "
           "alone; status 0: attained, -1: not attainable"),
    METHOD(line, METH_FASTCALL,
           "line(begin, way, vectors, normal, end): return how far it goes, and at most could go"),
    METHOD(prioritize, METH_FASTCALL,
           "prioritize(u, vectors): return the share of its line that the first group went"),
    METHOD(command, METH_FASTCALL,
           "command(vectors, shortest, longest, servos, middle, least, greatest, lengths, angles)"),
    {NULL, NULL, 0, NULL}};

static PyTypeObject vectored_type = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "ca_ros.kernel." NAME ".Vectored",
    .tp_doc = "Vectored(numbers): see vectored.h; the numbers are those of FIELDS, in their order.",
    .tp_basicsize = sizeof(object),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = PyType_GenericNew,
    .tp_init = (initproc)(void (*)(void))initialise,
    .tp_methods = methods,
};

static PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = NAME, .m_size = -1};

PyMODINIT_FUNC INIT(void)
{
    PyObject *self = module_of(&module, &vectored_type), *fields = PyDict_New();
    int done = self && fields;
#define ADD(name, dimensions)                                                                     \
    if (done) {                                                                                   \
        PyObject *text = PyUnicode_FromString(#dimensions);                                       \
        done = text && PyDict_SetItemString(fields, #name, text) == 0;                            \
        Py_XDECREF(text);                                                                         \
    }
    CA_VECTORED_FIELDS(ADD)
    if (!done || PyModule_AddObjectRef(self, "FIELDS", fields) < 0)
        Py_CLEAR(self);
    Py_XDECREF(fields);
    return self;
}
