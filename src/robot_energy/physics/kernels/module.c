/* The kernels as a Python module: numpy arrays in and out through the buffer protocol, with the
   stable ABI, so that one build serves all versions of Python. The lock of the interpreter is
   released while a kernel computes. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdlib.h>
#include <string.h>

#include "kernels.h"

#define MAX_ARRAYS 16

typedef struct {
    Py_buffer views[MAX_ARRAYS];
    int count;
} arrays;

static void release(arrays *held) {
    while (held->count) PyBuffer_Release(&held->views[--held->count]);
}

/* Take an array of doubles ('d') or of 64-bit integers ('q'); NULL with an exception set. */
static Py_buffer *take(arrays *held, PyObject *array, char kind, int axes, int writable) {
    Py_buffer *view = &held->views[held->count];
    if (PyObject_GetBuffer(array, view, PyBUF_STRIDES | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)))
        return NULL;
    held->count++;
    const char *format = view->format ? view->format : "B";
    int fits = kind == 'd' ? !strcmp(format, "d") : !strcmp(format, "l") || !strcmp(format, "q");
    if (fits && view->itemsize == 8 && view->ndim == axes) return view;
    PyErr_Format(PyExc_TypeError, "found an array of '%s' with %d axes; expected '%c' with %d",
                 format, view->ndim, kind, axes);
    return NULL;
}

/* Whether the numbers of an array stand one behind the other: rows of a matrix, or columns. */
static int dense(const Py_buffer *view, int by_column) {
    if (view->ndim == 1) return view->shape[0] < 2 || view->strides[0] == 8;
    Py_ssize_t near = view->strides[by_column ? 0 : 1], far = view->strides[by_column ? 1 : 0];
    Py_ssize_t inner = view->shape[by_column ? 0 : 1], outer = view->shape[by_column ? 1 : 0];
    return (inner < 2 || near == 8) && (outer < 2 || far == 8 * inner);
}

/* Whether times can be taken from each other; also whether they rise, where that is asked for. */
static int sound_times(const Py_buffer *view, Py_ssize_t count, int rising) {
    const int64_t *time = view->buf;
    for (Py_ssize_t row = 0; row < count; row++)
        if (time[row] <= -MOST_TIME || time[row] >= MOST_TIME
            || (rising && row && time[row] < time[row - 1]))
            return 0;
    return 1;
}

static int sound_time(long long time) { return -MOST_TIME < time && time < MOST_TIME; }

/* Whether an array holds numbers of 1, 2, 4 or 8 bytes: bytes written to objects are pointers. */
static int holds_numbers(const Py_buffer *view) {
    const char *format = view->format ? view->format : "B";
    if (*format && strchr("=<>@!", *format)) format++;
    return *format && strchr("?bBhHiIlLqQefd", *format) && !format[1]
           && (view->itemsize == 1 || view->itemsize == 2 || view->itemsize == 4
               || view->itemsize == 8);
}

static PyObject *refuse(arrays *held, const char *why) {
    if (why) PyErr_SetString(PyExc_ValueError, why);
    release(held);
    return NULL;
}

static int read_chain(chain *tree, const Py_buffer *table, const double *gravity) {
    tree->joints = (int)table->shape[0];
    memcpy(tree->gravity, gravity, sizeof tree->gravity);
    const double *row = table->buf;
    for (int i = 0; i < tree->joints; i++, row += BODY_COLUMNS) {
        body *b = &tree->bodies[i];
        if (!(row[0] >= 0 && row[0] <= i)) return 1;
        b->parent = (int)row[0];
        b->prismatic = row[1] != 0.0;
        memcpy(b->turn, row + 2, sizeof b->turn);
        memcpy(b->place, row + 11, sizeof b->place);
        b->mass = row[14];
        memcpy(b->first_moment, row + 15, sizeof b->first_moment);
        memcpy(b->inertia, row + 18, sizeof b->inertia);
    }
    return 0;
}

/* Eight rows of a matrix with any strides, joint by joint; the last row stands for those beyond. */
static void gather(double *tile, const Py_buffer *motion, Py_ssize_t first, int count) {
    for (Py_ssize_t joint = 0; joint < motion->shape[1]; joint++) {
        const char *from = (const char *)motion->buf + joint * motion->strides[1]
                           + first * motion->strides[0];
        if (count == LANES && motion->strides[0] == 8)
            memcpy(tile + joint * LANES, from, LANES * 8);
        else for (int lane = 0; lane < LANES; lane++)
            tile[joint * LANES + lane]
                = *(const double *)(from + (lane < count ? lane : count - 1) * motion->strides[0]);
    }
}

PyDoc_STRVAR(inverse_dynamics_doc,
"inverse_dynamics(table, gravity, position, velocity, acceleration, torque)\n--\n\n"
"Rigid-body torque of a tree of joints, by `robot_energy.physics.rigid_body`.");

static PyObject *inverse_dynamics(PyObject *self, PyObject *args) {
    PyObject *given[6];
    arrays held = {.count = 0};
    if (!PyArg_ParseTuple(args, "OOOOOO", &given[0], &given[1], &given[2], &given[3], &given[4],
                          &given[5]))
        return NULL;
    Py_buffer *table = take(&held, given[0], 'd', 2, 0);
    Py_buffer *gravity = table ? take(&held, given[1], 'd', 1, 0) : NULL;
    Py_buffer *motion[4] = {NULL};
    for (int i = 0; gravity && i < 4; i++)
        if (!(motion[i] = take(&held, given[2 + i], 'd', 2, i == 3))) break;
    if (!motion[3]) return refuse(&held, NULL);
    Py_ssize_t joints = table->shape[0], rows = motion[0]->shape[0];
    int fits = joints <= MAX_JOINTS && table->shape[1] == BODY_COLUMNS && dense(table, 0)
               && gravity->shape[0] == 3 && dense(gravity, 0) && dense(motion[3], 1);
    for (int i = 0; i < 4; i++)
        fits &= motion[i]->shape[0] == rows && motion[i]->shape[1] == joints;
    chain tree;
    if (!fits || read_chain(&tree, table, gravity->buf))
        return refuse(&held, "found arrays that do not fit each other, or a parent after its child");
    Py_BEGIN_ALLOW_THREADS
    _Alignas(64) double tile[4][MAX_JOINTS * LANES];
    for (Py_ssize_t first = 0; first < rows; first += LANES) {
        int count = rows - first < LANES ? (int)(rows - first) : LANES;
        for (int i = 0; i < 3; i++) gather(tile[i], motion[i], first, count);
        inverse_dynamics_lanes(&tree, tile[0], tile[1], tile[2], tile[3]);
        for (Py_ssize_t joint = 0; joint < joints; joint++)
            memcpy((double *)motion[3]->buf + joint * rows + first, tile[3] + joint * LANES,
                   (size_t)count * 8);
    }
    Py_END_ALLOW_THREADS
    release(&held);
    Py_RETURN_NONE;
}

PyDoc_STRVAR(slopes_doc,
"slopes(stamp_ns, values, out, start, behind_ns, ahead_ns, least_behind, least_ahead, scale)\n"
"--\n\nSlopes of local quadratics, for `robot_energy.physics.derivative`; False where a window is\n"
"too long.");

static PyObject *slopes_of(PyObject *self, PyObject *args) {
    PyObject *stamp_given, *values_given, *out_given;
    arrays held = {.count = 0};
    slopes task;
    long long start, behind_ns, ahead_ns, least_behind, least_ahead;
    if (!PyArg_ParseTuple(args, "OOOLLLLLd", &stamp_given, &values_given, &out_given, &start,
                          &behind_ns, &ahead_ns, &least_behind, &least_ahead, &task.scale))
        return NULL;
    Py_buffer *stamp = take(&held, stamp_given, 'q', 1, 0);
    Py_buffer *values = stamp ? take(&held, values_given, 'd', 2, 0) : NULL;
    Py_buffer *out = values ? take(&held, out_given, 'd', 2, 1) : NULL;
    if (!out) return refuse(&held, NULL);
    task.rows = stamp->shape[0];
    task.columns = values->shape[1];
    task.start = start;
    if (!dense(stamp, 0) || !dense(values, 1) || !dense(out, 1) || values->shape[0] != task.rows
        || out->shape[1] != task.columns || start < 0 || start > task.rows - out->shape[0])
        return refuse(&held, "found arrays that do not fit each other or are not by columns");
    task.stop = start + out->shape[0];
    if (behind_ns < 0 || ahead_ns < 0 || !sound_time(behind_ns) || !sound_time(ahead_ns)
        || least_behind < 0 || least_ahead < 0 || !sound_times(stamp, task.rows, 1))
        return refuse(&held, "found stamps that fall or lie beyond 2^62 ns, or a reach that does");
    double *time = malloc((size_t)(task.rows ? task.rows : 1) * sizeof *time);
    if (!time) {
        release(&held);
        return PyErr_NoMemory();
    }
    task.stamp = stamp->buf;
    task.time = time;
    task.values = values->buf;
    task.out = out->buf;
    task.behind_ns = behind_ns;
    task.ahead_ns = ahead_ns;
    task.least_behind = least_behind < task.rows ? least_behind : task.rows;
    task.least_ahead = least_ahead < task.rows ? least_ahead : task.rows;
    int too_long;
    Py_BEGIN_ALLOW_THREADS
    for (int64_t row = 0; row < task.rows; row++)
        time[row] = (double)(task.stamp[row] - task.stamp[0]);
    too_long = local_slopes(&task);
    Py_END_ALLOW_THREADS
    free(time);
    release(&held);
    return PyBool_FromLong(!too_long);
}

PyDoc_STRVAR(add_exactly_doc,
"add_exactly(energy, microjoule, remainder)\n--\n\n"
"Add energies to exact sums, for `robot_energy.accounting.exact_sum`.");

static PyObject *add_exactly(PyObject *self, PyObject *args) {
    PyObject *energy_given, *whole_given, *rest_given;
    arrays held = {.count = 0};
    if (!PyArg_ParseTuple(args, "OOO", &energy_given, &whole_given, &rest_given)) return NULL;
    Py_buffer *energy = take(&held, energy_given, 'd', 2, 0);
    Py_buffer *whole_sum = energy ? take(&held, whole_given, 'q', 1, 1) : NULL;
    Py_buffer *rest_sum = whole_sum ? take(&held, rest_given, 'q', 1, 1) : NULL;
    if (!rest_sum) return refuse(&held, NULL);
    Py_ssize_t columns = energy->shape[1];
    if (whole_sum->shape[0] != columns || rest_sum->shape[0] != columns || !dense(whole_sum, 0)
        || !dense(rest_sum, 0))
        return refuse(&held, "found arrays that do not fit each other");
    Py_BEGIN_ALLOW_THREADS
    for (Py_ssize_t column = 0; column < columns; column++)
        exact_sum_of_column((const char *)energy->buf + column * energy->strides[1],
                            energy->strides[0], energy->shape[0],
                            (int64_t *)whole_sum->buf + column, (int64_t *)rest_sum->buf + column);
    Py_END_ALLOW_THREADS
    release(&held);
    Py_RETURN_NONE;
}

PyDoc_STRVAR(messages_doc,
"messages(data, table, others, limit)\n--\n\n"
"Find the messages of a block of records, for `robot_energy.bag.mcap_records`; return their number,\n"
"that of other records, and the end of the last one.");

static PyObject *messages_in(PyObject *self, PyObject *args) {
    PyObject *data_given, *table_given, *others_given;
    arrays held = {.count = 0};
    messages found;
    long long limit;
    if (!PyArg_ParseTuple(args, "OOOL", &data_given, &table_given, &others_given, &limit))
        return NULL;
    Py_buffer *table = take(&held, table_given, 'q', 2, 1);
    Py_buffer *others = table ? take(&held, others_given, 'q', 1, 1) : NULL;
    Py_buffer *data = &held.views[held.count];
    if (!others || PyObject_GetBuffer(data_given, data, PyBUF_SIMPLE)) return refuse(&held, NULL);
    held.count++;
    found.table = table->buf;
    found.room = table->shape[1];
    found.others = others->buf;
    found.others_room = others->shape[0];
    found.limit = limit < found.room ? limit : found.room;
    if (table->shape[0] != 4 || !dense(table, 0) || !dense(others, 0))
        return refuse(&held, "found a table without four rows that follow each other");
    Py_BEGIN_ALLOW_THREADS
    messages_of(data->buf, (uint64_t)data->len, &found);
    Py_END_ALLOW_THREADS
    release(&held);
    return Py_BuildValue("LLL", (long long)found.count, (long long)found.others_count,
                         (long long)found.end);
}

/* Take arrays of a tuple, each an array of doubles in the order of columns; whether all are so. */
static int take_all(arrays *held, PyObject *given, Py_ssize_t count, int axes, Py_ssize_t rows,
                    Py_ssize_t columns, const double **found) {
    if (!PyTuple_Check(given) || PyTuple_Size(given) != count) {
        PyErr_Format(PyExc_TypeError, "expected a tuple of %zd arrays", count);
        return 0;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        Py_buffer *view = take(held, PyTuple_GetItem(given, i), 'd', axes, 0);
        if (!view) return 0;
        if (view->shape[0] != rows || (axes == 2 && view->shape[1] != columns)
            || !dense(view, 1)) {
            PyErr_SetString(PyExc_ValueError,
                            "found arrays that do not fit each other or are not by columns");
            return 0;
        }
        found[i] = view->buf;
    }
    return 1;
}

PyDoc_STRVAR(integrate_doc,
"integrate(cabinet, joint, before, half, last, energy, microjoule, remainder)\n--\n\n"
"Energies and sums of registers, for `robot_energy.accounting.registers`; whether all count.");

static PyObject *integrate(PyObject *self, PyObject *args) {
    PyObject *cabinet, *joint, *before_given, *half_given, *last_given, *energy_given, *whole_given,
        *rest_given;
    arrays held = {.count = 0};
    registers task;
    if (!PyArg_ParseTuple(args, "OOOOOOOO", &cabinet, &joint, &before_given, &half_given,
                          &last_given, &energy_given, &whole_given, &rest_given))
        return NULL;
    Py_buffer *energy = take(&held, energy_given, 'd', 2, 1);
    Py_buffer *before = energy ? take(&held, before_given, 'd', 1, 0) : NULL;
    Py_buffer *half = before ? take(&held, half_given, 'd', 1, 0) : NULL;
    Py_buffer *last = half ? take(&held, last_given, 'd', 1, 1) : NULL;
    Py_buffer *whole_sum = last ? take(&held, whole_given, 'q', 1, 1) : NULL;
    Py_buffer *rest_sum = whole_sum ? take(&held, rest_given, 'q', 1, 1) : NULL;
    if (!rest_sum) return refuse(&held, NULL);
    Py_ssize_t rows = energy->shape[0], columns = before->shape[0];
    task.rows = rows;
    task.kept = energy->shape[1];
    task.joints = (columns - CABINET_COLUMNS) / JOINT_COLUMNS;
    if (columns != CABINET_COLUMNS + JOINT_COLUMNS * task.joints || !dense(energy, 1)
        || task.kept > columns || last->shape[0] != columns || half->shape[0] != rows
        || whole_sum->shape[0] != columns || rest_sum->shape[0] != columns || !dense(before, 0)
        || !dense(half, 0) || !dense(last, 0) || !dense(whole_sum, 0) || !dense(rest_sum, 0))
        return refuse(&held, "found arrays that do not fit each other or are not by columns");
    if (!take_all(&held, cabinet, CABINET_COLUMNS - 1, 1, rows, 0, task.cabinet)
        || !take_all(&held, joint, JOINT_COLUMNS - 2, 2, rows, task.joints, task.joint))
        return refuse(&held, NULL);
    task.before = before->buf;
    task.half = half->buf;
    task.last = last->buf;
    task.energy = energy->buf;
    task.microjoule = whole_sum->buf;
    task.remainder = rest_sum->buf;
    task.scratch = malloc((size_t)(rows ? rows : 1) * sizeof(double));
    if (!task.scratch) {
        release(&held);
        return PyErr_NoMemory();
    }
    int sound;
    Py_BEGIN_ALLOW_THREADS
    sound = integrate_registers(&task);
    Py_END_ALLOW_THREADS
    free(task.scratch);
    release(&held);
    return PyBool_FromLong(sound);
}

/* Take a curve: begins, ends, powers there. */
static int take_curve(arrays *held, PyObject *given, pieces *curve) {
    const char *wrong = "expected a tuple of four arrays of one length that are not empty";
    if (!PyTuple_Check(given) || PyTuple_Size(given) != 4) {
        PyErr_SetString(PyExc_TypeError, wrong);
        return 0;
    }
    const void *found[4];
    for (int i = 0; i < 4; i++) {
        Py_buffer *view = take(held, PyTuple_GetItem(given, i), i < 2 ? 'q' : 'd', 1, 0);
        if (!view) return 0;
        if (!i) curve->count = view->shape[0];
        if (!curve->count || view->shape[0] != curve->count || !dense(view, 0)) {
            PyErr_SetString(PyExc_ValueError, wrong);
            return 0;
        }
        if (i < 2 && !sound_times(view, view->shape[0], 0)) {
            PyErr_SetString(PyExc_ValueError, "found a time beyond 2^62 ns");
            return 0;
        }
        found[i] = view->buf;
    }
    curve->start = found[0];
    curve->end = found[1];
    curve->start_power = found[2];
    curve->end_power = found[3];
    return 1;
}

PyDoc_STRVAR(compare_doc,
"compare(measured, predicted, start, until, available, duration, energy)\n--\n\n"
"Energies of two curves over what both cover, for `robot_energy.accounting.comparison`; how many.");

static PyObject *compare(PyObject *self, PyObject *args) {
    PyObject *measured_given, *predicted_given, *available_given, *duration_given, *energy_given;
    arrays held = {.count = 0};
    long long start, until, found;
    pieces measured, predicted;
    if (!PyArg_ParseTuple(args, "OOLLOOO", &measured_given, &predicted_given, &start, &until,
                          &available_given, &duration_given, &energy_given))
        return NULL;
    Py_buffer *available = take(&held, available_given, 'q', 1, 1);
    Py_buffer *duration = available ? take(&held, duration_given, 'q', 1, 1) : NULL;
    Py_buffer *energy = duration ? take(&held, energy_given, 'd', 2, 1) : NULL;
    if (!energy || !take_curve(&held, measured_given, &measured)
        || !take_curve(&held, predicted_given, &predicted))
        return refuse(&held, NULL);
    if (!sound_time(start) || !sound_time(until))
        return refuse(&held, "found a time beyond 2^62 ns");
    Py_ssize_t room = available->shape[0];
    if (duration->shape[0] != room || energy->shape[0] != room || energy->shape[1] != 2
        || !dense(available, 0) || !dense(duration, 0) || !dense(energy, 1))
        return refuse(&held, "found arrays that do not fit each other or are not by columns");
    Py_BEGIN_ALLOW_THREADS
    found = compare_curves(&measured, &predicted, start, until, available->buf, duration->buf,
                           energy->buf, room);
    Py_END_ALLOW_THREADS
    return found < 0 ? refuse(&held, "found too little room")
                     : (release(&held), PyLong_FromLongLong(found));
}

PyDoc_STRVAR(columns_doc,
"columns(buffer, offset, key, starts, stops, places, outs)\n--\n\n"
"Take columns out of messages of one layout, for `robot_energy.bag.cdr.decode`; whether all agree.");

static PyObject *columns_of(PyObject *self, PyObject *args) {
    PyObject *buffer_given, *offset_given, *key_given, *starts_given, *stops_given, *places, *outs;
    Py_buffer views[2 + MAX_COLUMNS];
    int count = 0, sound = 0;
    arrays held = {.count = 0};
    layout known;
    if (!PyArg_ParseTuple(args, "OOOOOOO", &buffer_given, &offset_given, &key_given, &starts_given,
                          &stops_given, &places, &outs))
        return NULL;
    Py_buffer *offset = take(&held, offset_given, 'q', 1, 0);
    Py_buffer *starts = offset ? take(&held, starts_given, 'q', 1, 0) : NULL;
    Py_buffer *stops = starts ? take(&held, stops_given, 'q', 1, 0) : NULL;
    if (!stops || PyObject_GetBuffer(buffer_given, &views[count], PyBUF_SIMPLE)) goto end;
    count++;
    if (PyObject_GetBuffer(key_given, &views[count], PyBUF_SIMPLE)) goto end;
    count++;
    known.key = views[1].buf;
    known.starts = starts->buf;
    known.stops = stops->buf;
    known.spans = starts->shape[0];
    known.columns = PyTuple_Check(outs) ? PyTuple_Size(outs) : -1;
    if (known.columns < 0 || known.columns > MAX_COLUMNS || !PyTuple_Check(places)
        || PyTuple_Size(places) != known.columns || stops->shape[0] != known.spans
        || !dense(offset, 0) || !dense(starts, 0) || !dense(stops, 0)) {
        PyErr_SetString(PyExc_ValueError, "found places, columns or spans that do not fit");
        goto end;
    }
    Py_ssize_t size = views[1].len, rows = offset->shape[0];
    for (int64_t span = 0; span < known.spans; span++)
        if (!(0 <= known.starts[span] && known.starts[span] <= known.stops[span]
              && known.stops[span] <= size)) {
            PyErr_SetString(PyExc_ValueError, "found a span beyond the key");
            goto end;
        }
    for (Py_ssize_t row = 0; row < rows; row++) {
        int64_t first = ((const int64_t *)offset->buf)[row];
        if (first < 0 || first > views[0].len - size) {
            PyErr_SetString(PyExc_ValueError, "found a message beyond the buffer");
            goto end;
        }
    }
    for (int64_t i = 0; i < known.columns; i++) {
        Py_buffer *view = &views[count];
        numbers *column = &known.column[i];
        column->place = PyLong_AsLongLong(PyTuple_GetItem(places, i));
        if (PyErr_Occurred()
            || PyObject_GetBuffer(PyTuple_GetItem(outs, i), view,
                                  PyBUF_F_CONTIGUOUS | PyBUF_WRITABLE | PyBUF_FORMAT))
            goto end;
        count++;
        if (!holds_numbers(view)) {
            PyErr_Format(PyExc_TypeError, "found a column of '%s'; expected numbers", view->format);
            goto end;
        }
        column->size = view->itemsize;
        column->count = view->ndim == 2 ? view->shape[1] : 1;
        column->out = view->buf;
        if (view->ndim < 1 || view->ndim > 2 || view->shape[0] != rows || column->place < 0
            || column->count > size / column->size
            || column->place > size - column->count * column->size) {
            PyErr_SetString(PyExc_ValueError, "found a column that does not fit");
            goto end;
        }
    }
    Py_BEGIN_ALLOW_THREADS
    sound = take_columns(views[0].buf, offset->buf, rows, &known) == rows;
    Py_END_ALLOW_THREADS
end:
    while (count) PyBuffer_Release(&views[--count]);
    release(&held);
    return PyErr_Occurred() ? NULL : PyBool_FromLong(sound);
}

static PyMethodDef methods[] = {
    {"inverse_dynamics", inverse_dynamics, METH_VARARGS, inverse_dynamics_doc},
    {"slopes", slopes_of, METH_VARARGS, slopes_doc},
    {"add_exactly", add_exactly, METH_VARARGS, add_exactly_doc},
    {"integrate", integrate, METH_VARARGS, integrate_doc},
    {"compare", compare, METH_VARARGS, compare_doc},
    {"columns", columns_of, METH_VARARGS, columns_doc},
    {"messages", messages_in, METH_VARARGS, messages_doc},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "_compiled",
    .m_doc = "Compiled kernels; see robot_energy.physics.kernels.",
    .m_methods = methods,
};

PyMODINIT_FUNC PyInit__compiled(void) { return PyModule_Create(&definition); }
