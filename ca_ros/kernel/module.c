/* The library as a Python module.
 *
 * `Kernel` holds one problem. Numbers come and go as buffers of double or, with CA_FLOAT, of float.
 */
#include "module.h"

#include "explanation.h"
#include "numbers.h"

/* `moved` is the problem within the bounds of the last call that gave any; each such call sets all
 * of them anew, under the lock of the interpreter. */
typedef struct {
    PyObject_HEAD
    ca_problem problem, moved;
} kernel;

/* Whether `__init__` has set up a problem; raises a ValueError if not. */
static int ready(const kernel *self)
{
    if (self->problem.n == 0)
        PyErr_SetString(PyExc_ValueError, "this Kernel has no problem: its set-up failed");
    return self->problem.n > 0;
}

/* Set the bounds lower and upper of `moved`. */
static int narrow(kernel *self, PyObject *const *arguments)
{
    const char formats[2] = {FORMAT, FORMAT};
    const Py_ssize_t widths[2] = {self->problem.n, self->problem.n};
    Py_buffer bounds[2];
    if (!get_all(arguments, 2, bounds, formats, widths, NULL, 2))
        return 0;
    const int fault = ca_set_bounds(&self->moved, bounds[0].buf, bounds[1].buf);
    release(2, bounds);
    if (fault)
        PyErr_SetString(PyExc_ValueError,
                        "bounds: a number is missing, or a lower bound is above its upper bound");
    return !fault;
}

PyDoc_STRVAR(allocate_doc,
             "allocate(u, demand, thrusts, lower=None, upper=None)\n--\n\n"
             "Copy u to demand, and write its thrusts, within narrower bounds if they are given; "
             "return None if they are exact, else (status, level).");

static PyObject *allocate(kernel *self, PyObject *const *arguments, Py_ssize_t count)
{
    if (!ready(self))
        return NULL;
    if (count != 3 && count != 5) {
        PyErr_SetString(PyExc_TypeError,
                        "expected u, demand and thrusts, and perhaps lower and upper");
        return NULL;
    }
    if (count == 5 && !narrow(self, arguments + 3))
        return NULL;
    Py_buffer views[2];
    const char formats[2] = {FORMAT, FORMAT};
    const Py_ssize_t widths[2] = {self->problem.m, self->problem.n};
    ca_answer answer = {CA_EXACT, 1, 0, 0};
    if (!get_all(arguments + 1, 2, views, formats, widths, NULL, 0))
        return NULL;
    const int copied = copy_from(arguments[0], self->problem.m, views[0].buf);
    if (copied)
        answer = ca_allocate(count == 5 ? &self->moved : &self->problem, views[0].buf,
                             views[1].buf);
    release(2, views);
    return copied ? answer_of(answer.status, answer.level) : NULL;
}

PyDoc_STRVAR(explain_doc,
             "explain(u, thrusts, numbers, names, lower=None, upper=None)\n--\n\n"
             "Write why thrusts are the answer to u: into numbers (m, 3 + n) what was served, the "
             "joint gain, the gain of the limit on airmode and those of the rotors, into names "
             "(m + 1, 1 + n) the blocks, those of the limit on airmode first, and last the limits. "
             "Both are flat. Return the margin.");

static PyObject *explain(kernel *self, PyObject *const *arguments, Py_ssize_t count)
{
    const int n = self->problem.n, m = self->problem.m;
    const char formats[4] = {FORMAT, FORMAT, FORMAT, 'i'};
    const Py_ssize_t widths[4] = {m, n, (Py_ssize_t)m * (3 + n), (Py_ssize_t)(m + 1) * (1 + n)};
    Py_buffer views[4];
    ca_explanation found;
    if (!ready(self))
        return NULL;
    if (count != 4 && count != 6) {
        PyErr_SetString(PyExc_TypeError,
                        "expected u, thrusts, numbers and names, and perhaps lower and upper");
        return NULL;
    }
    if (count == 6 && !narrow(self, arguments + 4))
        return NULL;
    if (!get_all(arguments, 4, views, formats, widths, NULL, 2))
        return NULL;
    ca_explain(count == 6 ? &self->moved : &self->problem, views[0].buf, views[1].buf, &found);
    ca_real *numbers = views[2].buf;
    int *names = views[3].buf;
    for (int k = 0; k < m; k++) {
        *numbers++ = found.served[k];
        *numbers++ = found.joint_gain[k];
        *numbers++ = found.airmode[k];
        *names++ = found.airmode_blocks[k];
        for (int i = 0; i < n; i++) {
            *numbers++ = found.gain[k][i];
            *names++ = found.blocks[k][i];
        }
    }
    *names++ = 0;
    for (int i = 0; i < n; i++)
        *names++ = found.limit[i];
    release(4, views);
    /* The kernel has no infinities. */
    return PyFloat_FromDouble(found.margin > -CA_UNBOUNDED ? (double)found.margin : -Py_HUGE_VAL);
}

PyDoc_STRVAR(allocate_batch_doc,
             "allocate_batch(wrenches, thrusts, status, levels, work)\n--\n\n"
             "Write thrusts, status (int8), levels and work (int32, steps and pivots, or "
             "None) for each of the wrenches; other Python threads run meanwhile.");

static PyObject *allocate_batch(kernel *self, PyObject *const *arguments, Py_ssize_t count)
{
    const ca_problem *problem = &self->problem;
    const int n = problem->n, m = problem->m;
    const char formats[5] = {FORMAT, FORMAT, 'b', FORMAT, 'i'};
    const Py_ssize_t widths[5] = {m, n, 1, 1, 2};
    Py_buffer views[5];
    Py_ssize_t rows = -1;
    if (!ready(self))
        return NULL;
    if (count != 5) {
        PyErr_SetString(PyExc_TypeError, "expected wrenches, thrusts, status, levels and work");
        return NULL;
    }
    const int given = arguments[4] == Py_None ? 4 : 5;
    if (!get_all(arguments, given, views, formats, widths, &rows, 1))
        return NULL;
    const ca_real *wrenches = views[0].buf;
    ca_real *thrusts = views[1].buf, *levels = views[3].buf;
    signed char *status = views[2].buf;
    int *work = given == 5 ? views[4].buf : NULL;
    Py_BEGIN_ALLOW_THREADS
    for (Py_ssize_t i = 0; i < rows; i++) {
        const ca_answer answer = ca_allocate(problem, wrenches + i * m, thrusts + i * n);
        status[i] = (signed char)answer.status;
        levels[i] = answer.level;
        if (work) {
            work[2 * i] = answer.steps;
            work[2 * i + 1] = answer.pivots;
        }
    }
    Py_END_ALLOW_THREADS
    release(given, views);
    Py_RETURN_NONE;
}

PyDoc_STRVAR(margin_doc, "margin(u)\n--\n\n"
                         "Return the signed distance of u to the boundary of the admissible set.");

static PyObject *margin(kernel *self, PyObject *wrench)
{
    Py_buffer u;
    ca_real distance;
    if (!ready(self) || !get(wrench, &u, FORMAT, self->problem.m, NULL, 0))
        return NULL;
    Py_BEGIN_ALLOW_THREADS
    distance = ca_margin(&self->problem, u.buf);
    Py_END_ALLOW_THREADS
    PyBuffer_Release(&u);
    return PyFloat_FromDouble((double)distance);
}

static int keep_ints(PyObject *fields, const char *name, const char *dimensions,
                     const int *numbers, size_t size)
{
    const Py_ssize_t count = (Py_ssize_t)(size / sizeof *numbers);
    PyObject *list = PyList_New(count);
    for (Py_ssize_t i = 0; list && i < count; i++)
        PyList_SET_ITEM(list, i, PyLong_FromLong(numbers[i]));
    PyObject *entry = list ? Py_BuildValue("(ssN)", "int", dimensions, list) : NULL;
    const int done = entry && PyDict_SetItemString(fields, name, entry) == 0;
    Py_XDECREF(entry);
    return done;
}

static int keep_ca_reals(PyObject *fields, const char *name, const char *dimensions,
                         const ca_real *numbers, size_t size)
{
    const Py_ssize_t count = (Py_ssize_t)(size / sizeof *numbers);
    PyObject *list = PyList_New(count);
    for (Py_ssize_t i = 0; list && i < count; i++)
        PyList_SET_ITEM(list, i, PyFloat_FromDouble((double)numbers[i]));
    PyObject *entry = list ? Py_BuildValue("(ssN)", "ca_real", dimensions, list) : NULL;
    const int done = entry && PyDict_SetItemString(fields, name, entry) == 0;
    Py_XDECREF(entry);
    return done;
}

PyDoc_STRVAR(fields_doc, "fields()\n--\n\n"
                         "Return the fields of ca_problem in their order: name to (type, "
                         "dimensions, numbers).");

static PyObject *fields(kernel *self, PyObject *unused)
{
    PyObject *fields = PyDict_New();
    int done = fields != NULL;
    (void)unused;
#define CA_KEEP(type, name, dimensions)                                                           \
    done = done && keep_##type##s(fields, #name, #dimensions,                                     \
                                  (const type *)&self->problem.name, sizeof self->problem.name);
    CA_FIELDS(CA_KEEP)
    if (!done) {
        Py_XDECREF(fields);
        return NULL;
    }
    return fields;
}

static int copy_ints(PyObject *sequence, int count, int *numbers)
{
    for (int i = 0; i < count; i++) {
        PyObject *item = PySequence_GetItem(sequence, i);
        if (!item)
            return 0;
        numbers[i] = (int)PyLong_AsLong(item);
        Py_DECREF(item);
        if (PyErr_Occurred())
            return 0;
    }
    return 1;
}

static const char *const FAULTS[] = {
    "", "too many rotors or axes",
    "a number is not finite, a lower bound above its upper bound, or a weight not positive",
    "the rotors cannot control the axes independently",
    "the order does not name each axis once, group by group"};

/* Kernel(gamma, lower, upper, reference, order, group, keep_sense, policy, on_reference, slack,
 *        weight=None, preferred=None, thrust=-1, airmode=None, impaired=None, rest=None,
 *        nearly_level=0)
 *
 * `airmode` has two numbers. `rest` (m, n) is what gamma loses in single precision. */
static int initialise(kernel *self, PyObject *arguments, PyObject *keywords)
{
    static char *names[] = {"gamma", "lower", "upper", "reference", "order", "group",
                            "keep_sense", "policy", "on_reference", "slack", "weight",
                            "preferred", "thrust", "airmode", "impaired", "rest",
                            "nearly_level", NULL};
    PyObject *inputs[6] = {NULL}, *order, *group, *senses, *impaired = NULL, *rest = NULL;
    Py_buffer views[6], rests;
    ca_options options;
    double slack, airmode[2] = {1, 1};
    int taken = 0, fault = CA_BAD_SIZE;
    options.thrust = -1;
    options.nearly_level = 0;
    if (self->problem.n) {
        /* Another thread may be using it. */
        PyErr_SetString(PyExc_ValueError, "this Kernel has a problem: make another Kernel");
        return -1;
    }
    if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOOOOOOipd|OOi(dd)OOp", names,
                                     &inputs[0], &inputs[1], &inputs[2], &inputs[3], &order,
                                     &group, &senses, &options.policy, &options.on_reference,
                                     &slack, &inputs[4], &inputs[5], &options.thrust, &airmode[0],
                                     &airmode[1], &impaired, &rest, &options.nearly_level))
        return -1;
    options.airmode_limited = 1;
    for (int i = 0; i < 2; i++)
        options.airmode[i] = (ca_real)airmode[i];
    options.reports_health = impaired && impaired != Py_None;
    options.refined = rest && rest != Py_None;
    const Py_ssize_t m = PySequence_Length(order);
    options.slack = (ca_real)slack;
    options.weighted = inputs[4] && inputs[4] != Py_None;
    if (options.weighted != (inputs[5] && inputs[5] != Py_None)) {
        PyErr_SetString(PyExc_ValueError, "give weight and preferred, or neither");
        return -1;
    }
    if (m >= 1 && m <= CA_M && copy_ints(order, (int)m, options.order) &&
        copy_ints(group, (int)m, options.group) && copy_ints(senses, (int)m, options.keep_sense)) {
        const int given = options.weighted ? 6 : 4;
        Py_ssize_t n = -1, widths[6] = {m, 1, 1, m, 1, 1};
        while (taken < given && get(inputs[taken], &views[taken], FORMAT, widths[taken],
                                    taken != 3 ? &n : NULL, 0))
            taken++;
        if (taken == given && n <= CA_N &&
            (!options.reports_health || copy_ints(impaired, (int)n, options.impaired))) {
            for (Py_ssize_t i = 0; given == 6 && i < n; i++) {
                options.weight[i] = ((const ca_real *)views[4].buf)[i];
                options.preferred[i] = ((const ca_real *)views[5].buf)[i];
            }
            if (options.refined && get(rest, &rests, FORMAT, m * n, NULL, 0)) {
                for (Py_ssize_t k = 0; k < m * n; k++)
                    options.rest[k / n][k % n] = ((const ca_real *)rests.buf)[k];
                PyBuffer_Release(&rests);
            }
            for (int k = 0; k < m; k++)
                options.reference[k] = ((const ca_real *)views[3].buf)[k];
            if (!PyErr_Occurred())
                fault = ca_set_up(&self->problem, (int)n, (int)m, views[0].buf, views[1].buf,
                                  views[2].buf, &options);
            self->moved = self->problem;
        }
        release(taken, views);
    }
    if (!PyErr_Occurred() && fault)
        PyErr_SetString(PyExc_ValueError, FAULTS[fault]);
    return PyErr_Occurred() ? -1 : 0;
}

static PyMethodDef methods[] = {
    METHOD(allocate, METH_FASTCALL, allocate_doc),
    METHOD(allocate_batch, METH_FASTCALL, allocate_batch_doc),
    METHOD(explain, METH_FASTCALL, explain_doc),
    METHOD(margin, METH_O, margin_doc),
    METHOD(fields, METH_NOARGS, fields_doc),
    {NULL, NULL, 0, NULL}};

static PyTypeObject kernel_type = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "ca_ros.kernel." NAME ".Kernel",
    .tp_doc = "The exact allocator for one problem, in C.",
    .tp_basicsize = sizeof(kernel),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = PyType_GenericNew,
    .tp_init = (initproc)(void (*)(void))initialise,
    .tp_methods = methods,
};

static PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = NAME, .m_size = -1};

PyMODINIT_FUNC INIT(void)
{
    return module_of(&module, &kernel_type);
}
