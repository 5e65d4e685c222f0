/* The detector of rotor failures as a Python module. Numbers come and go as buffers of double. */
#include "module.h"

#include "detector.h"

typedef struct {
    PyObject_HEAD
    ca_detector_model model;
    ca_detector detector;
} object;

static int rotors(const object *self)
{
    return (int)self->model.rotors;
}

/* Copy numbers to an array of doubles. */
static PyObject *copy_to(const ca_real *numbers, int count, PyObject *array)
{
    Py_buffer view;
    if (!get(array, &view, 'd', count, NULL, 1))
        return NULL;
    for (int i = 0; i < count; i++)
        ((double *)view.buf)[i] = (double)numbers[i];
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

/* Copy numbers; lists and integers are converted, which takes longer. */
static int copy_numbers(PyObject *given, const char *name, int count, ca_real *numbers)
{
    if (copy_from(given, count, numbers))
        return 1;
    PyErr_Clear();
    PyObject *numpy = PyImport_ImportModule("numpy");
    PyObject *array = numpy ? PyObject_CallMethod(numpy, "asarray", "Os", given, "d") : NULL;
    const int done = array && copy_from(array, count, numbers);
    Py_XDECREF(numpy);
    Py_XDECREF(array);
    if (!done)
        PyErr_Format(PyExc_ValueError, "%s %S: expected %d numbers", name, given, count);
    return done;
}

/* Get a time and the arrays that follow it, of the given names and sizes. */
static int take(const object *self, PyObject *const *arguments, Py_ssize_t count,
                const char *const *names, const int *sizes, int arrays, int64_t *time,
                ca_real *numbers)
{
    if (!rotors(self) || count != arrays + 1) {
        PyErr_SetString(PyExc_TypeError, "expected a detector with a model, a time and arrays");
        return 0;
    }
    int overflow;
    *time = PyLong_AsLongLongAndOverflow(arguments[0], &overflow);
    if (PyErr_Occurred()) {
        PyErr_Format(PyExc_TypeError,
                     "time %S: expected whole nanoseconds, such as int(1e9 * seconds)",
                     arguments[0]);
        return 0;
    }
    if (overflow || *time <= -CA_TIME_MAX || *time >= CA_TIME_MAX) {
        PyErr_Format(PyExc_ValueError, "time %S: expected a number of nanoseconds below 2**62",
                     arguments[0]);
        return 0;
    }
    for (int k = 0; k < arrays; numbers += sizes[k], k++)
        if (!copy_numbers(arguments[k + 1], names[k], sizes[k], numbers))
            return 0;
    return 1;
}

static PyObject *command(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    const int sizes[1] = {rotors(self)};
    ca_real speeds[CA_N];
    int64_t time;
    if (!take(self, arguments, count, (const char *[]){"command"}, sizes, 1, &time, speeds))
        return NULL;
    if (ca_detector_command(&self->detector, time, speeds) < 0)
        return PyErr_Format(PyExc_ValueError, "command %S: expected %d numbers up to 1e100",
                            arguments[1], rotors(self));
    Py_RETURN_NONE;
}

static PyObject *measure(object *self, PyObject *const *arguments, Py_ssize_t count)
{
    const int sizes[1] = {rotors(self)};
    ca_real speeds[CA_N];
    int64_t time;
    if (!take(self, arguments, count, (const char *[]){"speeds"}, sizes, 1, &time, speeds))
        return NULL;
    const int changed = ca_detector_measure(&self->detector, time, speeds);
    if (changed < 0)
        return PyErr_Format(PyExc_ValueError, "speeds %S: expected %d numbers up to 1e100",
                            arguments[1], rotors(self));
    return PyBool_FromLong(changed);
}

/* Find the arguments of observe, of which some have names; a specific force need not be there. */
static int find_arguments(PyObject *const *arguments, Py_ssize_t count, PyObject *names,
                          PyObject **found)
{
    static const char *const expected[5] = {"time", "attitude", "velocity", "angular_velocity",
                                            "specific_force"};
    if (count > 5) {
        PyErr_Format(PyExc_TypeError, "observe: expected 5 arguments at most, got %zd", count);
        return 0;
    }
    for (int k = 0; k < 5; k++)
        found[k] = k < count ? arguments[k] : NULL;
    for (Py_ssize_t i = 0; names && i < PyTuple_GET_SIZE(names); i++) {
        PyObject *name = PyTuple_GET_ITEM(names, i);
        int k = 0;
        while (k < 5 && PyUnicode_CompareWithASCIIString(name, expected[k]))
            k++;
        if (k == 5 || found[k]) {
            PyErr_Format(PyExc_TypeError, "observe: %s argument %R",
                         k == 5 ? "unexpected" : "two values for", name);
            return 0;
        }
        found[k] = arguments[count + i];
    }
    for (int k = 0; k < 4; k++)
        if (!found[k]) {
            PyErr_Format(PyExc_TypeError, "observe: missing argument '%s'", expected[k]);
            return 0;
        }
    return 1;
}

static PyObject *observe(object *self, PyObject *const *arguments, Py_ssize_t count,
                         PyObject *names)
{
    static const char *const parts[4] = {"attitude", "velocity", "angular velocity",
                                         "specific force"};
    const int sizes[4] = {4, 3, 3, 3};
    ca_real state[13];
    int64_t time;
    PyObject *found[5];
    if ((names && PyTuple_GET_SIZE(names)) || count < 4 || count > 5) {
        if (!find_arguments(arguments, count, names, found))
            return NULL;
        arguments = found;
        count = found[4] ? 5 : 4;
    }
    const int measured = count == 5 && arguments[4] != Py_None;
    if (!take(self, arguments, 4 + measured, parts, sizes, 3 + measured, &time, state))
        return NULL;
    for (int k = 10; measured && k < 13; k++)
        if (!(state[k] >= -CA_STATE_MAX && state[k] <= CA_STATE_MAX))
            return PyErr_Format(PyExc_ValueError,
                                "specific force %S: expected three numbers up to 1e9",
                                arguments[4]);
    const int changed =
        ca_detector_observe(&self->detector, time, state, state + 4, measured ? state + 10 : NULL);
    if (changed < 0)
        return PyErr_Format(PyExc_ValueError,
                            "attitude %S, velocities %S and %S: expected a quaternion that is not "
                            "zero, and numbers up to 1e9",
                            arguments[1], arguments[2], arguments[3]);
    return PyBool_FromLong(changed);
}

static PyObject *announce(object *self, PyObject *array)
{
    ca_real health[CA_N];
    if (!copy_numbers(array, "health", rotors(self), health))
        return NULL;
    if (ca_detector_announce(&self->detector, health) < 0)
        return PyErr_Format(PyExc_ValueError, "health %S: expected %d numbers in [0, 1]", array,
                            rotors(self));
    Py_RETURN_NONE;
}

static PyObject *reset(object *self, PyObject *unused)
{
    (void)unused;
    ca_detector_reset(&self->detector);
    Py_RETURN_NONE;
}

static PyObject *interrupt(object *self, PyObject *unused)
{
    (void)unused;
    ca_detector_interrupt(&self->detector);
    Py_RETURN_NONE;
}

static PyObject *health(object *self, PyObject *array)
{
    return copy_to(self->detector.health, rotors(self), array);
}

static PyObject *probabilities(object *self, PyObject *array)
{
    return copy_to(self->detector.probabilities, rotors(self) + 1, array);
}

static PyObject *status(object *self, PyObject *unused)
{
    (void)unused;
    const ca_detector *detector = &self->detector;
    const int in_air = detector->flown > 0 && !detector->standing;
    const int tested = detector->rested || detector->flown >= CA_UNTESTED;
    const int testing = in_air && detector->known && tested;
    return Py_BuildValue("(iii)", detector->suspect, detector->standing, testing);
}

static PyObject *failures(object *self, PyObject *unused)
{
    (void)unused;
    PyObject *list = PyList_New(rotors(self));
    for (int i = 0; list && i < rotors(self); i++) {
        PyObject *item = Py_BuildValue("(Liii)", (long long)self->detector.since[i],
                                       self->detector.order[i], self->detector.evidence[i],
                                       self->detector.arm[i] ? (int)self->model.partner[i] : -1);
        if (!item) {
            Py_CLEAR(list);
            break;
        }
        PyList_SET_ITEM(list, i, item);
    }
    return list;
}

static int initialise(object *self, PyObject *arguments, PyObject *keywords)
{
    PyObject *array;
    ca_detector_model model;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O", &array))
        return -1;
    if (!copy_from(array, (int)(sizeof model / sizeof(ca_real)), (ca_real *)&model))
        return -1;
    if (!(model.rotors >= 1 && model.rotors <= CA_N)) {
        PyErr_Format(PyExc_ValueError, "expected 1 to %d rotors", CA_N);
        return -1;
    }
    self->model = model;
    ca_detector_start(&self->detector, &self->model);
    return 0;
}

static PyMethodDef methods[] = {
    METHOD(command, METH_FASTCALL, "command(time, speeds): see detector.h"),
    METHOD(measure, METH_FASTCALL, "measure(time, speeds): return whether the health has changed"),
    METHOD(observe, METH_FASTCALL | METH_KEYWORDS,
           "observe(time, attitude, velocity, angular_velocity[, specific_force]): return whether "
           "the health has changed"),
    METHOD(announce, METH_O, "announce(health)"),
    METHOD(reset, METH_NOARGS, "reset()"),
    METHOD(interrupt, METH_NOARGS, "interrupt(): the next state does not continue those before"),
    METHOD(health, METH_O, "health(array): write the health of the rotors"),
    METHOD(probabilities, METH_O,
           "probabilities(array): write those of each failure and of a disturbance"),
    METHOD(status, METH_NOARGS, "status(): return the suspect or -1, whether it stands, and is tested"),
    METHOD(failures, METH_NOARGS, "failures(): return (since, order, evidence, partner in a named arm or -1) of each rotor"),
    {NULL, NULL, 0, NULL}};

static PyTypeObject detector_type = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "ca_ros.kernel." NAME ".Detector",
    .tp_doc = "Detector(model): the detector of rotor failures in C; the model holds the numbers of "
              "FIELDS, one after the other.",
    .tp_basicsize = sizeof(object),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = PyType_GenericNew,
    .tp_init = (initproc)(void (*)(void))initialise,
    .tp_methods = methods,
};

static PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = NAME, .m_size = -1};

PyMODINIT_FUNC INIT(void)
{
    PyObject *self = module_of(&module, &detector_type), *fields = PyDict_New();
    int done = self && fields;
#define ADD(name, dimensions)                                                                     \
    if (done) {                                                                                   \
        PyObject *sizes = PyUnicode_FromString(TEXT_OF(dimensions));                              \
        done = sizes && PyDict_SetItemString(fields, #name, sizes) == 0;                          \
        Py_XDECREF(sizes);                                                                        \
    }
    CA_DETECTOR_FIELDS(ADD)
    if (!done || PyModule_AddObjectRef(self, "FIELDS", fields) < 0 ||
        PyModule_AddIntConstant(self, "SEGMENTS", CA_SEGMENTS) < 0)
        Py_CLEAR(self);
    Py_XDECREF(fields);
    return self;
}
