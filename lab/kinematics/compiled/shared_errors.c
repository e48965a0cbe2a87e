/* Errors that poses share, in machine code, a part of kernels.c: the filter of lab/noise/correlation.py.
 *
 * All arrays are contiguous; n poses of m numbers, s components of a state, c columns of rows to be made white. */

/* The variance `spread` (s, s) of a state one pose on, its observation, and what is left of it after that. */
static int observed_once(const double *own, const double *h, const double *through, Py_ssize_t m, Py_ssize_t s,
                         double *spread, double *pull, double *l, double *factor, double *gain)
{
    for (Py_ssize_t i = 0; i < s; i++)
        for (Py_ssize_t j = 0; j < s; j++)
            spread[i * s + j] = through[i] * spread[i * s + j] * through[j] + (i == j ? 1 - through[i] * through[i] : 0);
    for (Py_ssize_t i = 0; i < s; i++)
        for (Py_ssize_t j = 0; j < m; j++) {
            double sum = 0;
            for (Py_ssize_t k = 0; k < s; k++) sum += spread[i * s + k] * h[j * s + k];
            pull[i * m + j] = sum;
        }
    for (Py_ssize_t i = 0; i < m; i++)
        for (Py_ssize_t j = 0; j <= i; j++) {
            double sum = own[i * m + j];
            for (Py_ssize_t k = 0; k < s; k++) sum += h[i * s + k] * pull[k * m + j];
            for (Py_ssize_t k = 0; k < j; k++) sum -= l[i * m + k] * l[j * m + k];
            if (i == j && !(sum > 0)) return 0;
            l[i * m + j] = i == j ? sqrt(sum) : sum / l[j * m + j];
        }
    for (Py_ssize_t j = 0; j < m; j++)
        for (Py_ssize_t i = 0; i < m; i++) {
            double sum = i == j;
            for (Py_ssize_t k = j; k < i; k++) sum -= l[i * m + k] * factor[k * m + j];
            factor[i * m + j] = i < j ? 0 : sum / l[i * m + i];
        }
    for (Py_ssize_t i = 0; i < s; i++)
        for (Py_ssize_t j = 0; j < m; j++) {
            double sum = 0;
            for (Py_ssize_t k = 0; k <= j; k++) sum += pull[i * m + k] * factor[j * m + k];
            gain[i * m + j] = sum;
        }
    for (Py_ssize_t i = 0; i < s; i++)
        for (Py_ssize_t j = 0; j < s; j++)
            for (Py_ssize_t k = 0; k < m; k++) spread[i * s + j] -= gain[i * m + k] * gain[j * m + k];
    return 1;
}

static int within(const int64_t *order, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++)
        if (order[i] < 0 || order[i] >= n) return 0;
    return 1;
}

/* innovations(m, s, own, observed, through, order, factors, gains): numpy_kernels.innovations; False where a variance is
 * not positive. */
static PyObject *innovations(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Py_ssize_t n, sizes[5], all = 1;
    const double *own, *h, *through;
    const int64_t *order;
    double *factors, *gains;
    if (given != 8) return wrong(&held);
    Py_ssize_t m = PyLong_AsSsize_t(args[0]), s = PyLong_AsSsize_t(args[1]);
    if (PyErr_Occurred() || !(own = numbers(&held, args[2], 0, 8, &sizes[0]))
        || !(h = numbers(&held, args[3], 0, 8, &sizes[1])) || !(through = numbers(&held, args[4], 0, 8, &sizes[2]))
        || !(order = numbers(&held, args[5], 0, 8, &n)) || !(factors = numbers(&held, args[6], 1, 8, &sizes[3]))
        || !(gains = numbers(&held, args[7], 1, 8, &sizes[4])))
        return wrong(&held);
    if (m < 1 || s < 1 || sizes[0] != n * m * m || sizes[1] != n * m * s || sizes[2] != n * s || sizes[3] != n * m * m
        || sizes[4] != n * m * s || !within(order, n))
        return wrong(&held);
    double *spread = calloc(s * s + s * m + m * m, sizeof(double));
    if (spread == NULL) {
        let_go(&held);
        return PyErr_NoMemory();
    }
    double *pull = spread + s * s, *l = pull + s * m;
    for (Py_ssize_t i = 0; i < s; i++) spread[i * s + i] = 1;
    for (Py_ssize_t i = 0; i < n && all; i++) {
        int64_t t = order[i];
        all = observed_once(own + t * m * m, h + t * m * s, through + t * s, m, s, spread, pull, l, factors + t * m * m,
                            gains + t * s * m);
    }
    free(spread);
    let_go(&held);
    return PyBool_FromLong((long)all);
}

/* whiten(m, s, factors, observed, gains, through, order, rows, done): numpy_kernels.whiten. */
WIDE static PyObject *whiten(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Py_ssize_t n, sizes[6];
    const double *factors, *h, *gains, *through, *rows;
    const int64_t *order;
    double *done;
    if (given != 9) return wrong(&held);
    Py_ssize_t m = PyLong_AsSsize_t(args[0]), s = PyLong_AsSsize_t(args[1]);
    if (PyErr_Occurred() || !(factors = numbers(&held, args[2], 0, 8, &sizes[0]))
        || !(h = numbers(&held, args[3], 0, 8, &sizes[1])) || !(gains = numbers(&held, args[4], 0, 8, &sizes[2]))
        || !(through = numbers(&held, args[5], 0, 8, &sizes[3])) || !(order = numbers(&held, args[6], 0, 8, &n))
        || !(rows = numbers(&held, args[7], 0, 8, &sizes[4])) || !(done = numbers(&held, args[8], 1, 8, &sizes[5])))
        return wrong(&held);
    if (m < 1 || s < 1 || n < 1 || sizes[0] != n * m * m || sizes[1] != n * m * s || sizes[2] != n * m * s
        || sizes[3] != n * s || sizes[4] % (n * m) || sizes[5] != sizes[4] || !within(order, n))
        return wrong(&held);
    Py_ssize_t c = sizes[4] / (n * m);
    double *state = calloc((s + m) * c + 1, sizeof(double));
    if (state == NULL) {
        let_go(&held);
        return PyErr_NoMemory();
    }
    double *new = state + s * c;
    for (Py_ssize_t at = 0; at < n; at++) {
        int64_t t = order[at];
        memcpy(new, rows + t * m * c, m * c * sizeof(double));
        for (Py_ssize_t k = 0; k < s; k++) {
            double *restrict mine = state + k * c, keeps = through[t * s + k];
            for (Py_ssize_t q = 0; q < c; q++) mine[q] *= keeps;
            for (Py_ssize_t i = 0; i < m; i++) {
                double *restrict row = new + i * c, by = h[(t * m + i) * s + k];
                if (by == 0) continue;
                for (Py_ssize_t q = 0; q < c; q++) row[q] -= by * mine[q];
            }
        }
        for (Py_ssize_t i = 0; i < m; i++) {
            double *restrict to = done + (t * m + i) * c;
            memset(to, 0, c * sizeof(double));
            for (Py_ssize_t j = 0; j <= i; j++) {
                const double *restrict row = new + j * c, by = factors[(t * m + i) * m + j];
                for (Py_ssize_t q = 0; q < c; q++) to[q] += by * row[q];
            }
            for (Py_ssize_t k = 0; k < s; k++) {
                double *restrict mine = state + k * c, by = gains[(t * s + k) * m + i];
                if (by == 0) continue;
                for (Py_ssize_t q = 0; q < c; q++) mine[q] += by * to[q];
            }
        }
    }
    free(state);
    let_go(&held);
    Py_RETURN_NONE;
}
