/* Kinematics in machine code: the walk along serial chains and small linear algebra; inverse.c has closed forms of inverses,
 * shared_errors.c the filter of errors that poses share.
 *
 * Each function does what the numpy code that its comment names does, in the same order of sums, some poses at a time:
 * numpy's is the reference, and does all where there is no compiler (kernels.py chooses, numpy_kernels.py computes).
 * Contraction to fused operations is off.
 * Arrays are C-contiguous; lengths are checked here, shapes by the caller.
 */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#define _GNU_SOURCE         /* M_PI */
#define _USE_MATH_DEFINES   /* M_PI on Windows */
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define VERSION 10 /* which kernels.py takes alone */

#define BLOCK 32      /* poses at a time: what fits the processor's first cache */
#define PER_LINK 6    /* axes that a link makes: x y of the joint, y z of alpha, z x of beta */
#define RELEASE 200   /* poses from which on other threads may run meanwhile */

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__linux__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif
#if defined(__GNUC__) || defined(__clang__)
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

typedef double Vector[3][BLOCK];

typedef struct {
    const double (*axis)[BLOCK];
    const double (*origin)[BLOCK]; /* NULL of a slide */
    int joint;                     /* whose position moves along, or -1 */
} Motion;

typedef struct {
    int distal, links, targets, parameters;
    const int64_t *slides, *parallel; /* (links,) each */
    const double *sign;               /* (links,) */
} Arm;

typedef struct {
    Vector *axes, *origins; /* (6 + PER_LINK links), (1 + links) */
    Motion *motions;        /* (parameters before the tool's) */
    const double (*frame[3])[BLOCK];
    const double (*origin)[BLOCK];
} Walk;

/* ------------------------------------------------------------------------------------------------ rotations */

static void series(double s, double *a, double *b, double *c) /* lab.core.se3._angle_series */
{
    if (fabs(s) < 1e-4) {
        *a = 1 - s / 6 * (1 - s / 20 * (1 - s / 42));
        *b = 0.5 - s / 24 * (1 - s / 30 * (1 - s / 56));
        *c = 1.0 / 6 - s / 120 * (1 - s / 42 * (1 - s / 72));
        return;
    }
    double t = sqrt(s), sine = sin(t), half = sin(t / 2);
    *a = sine / t;
    *b = 2 * (half * half) / s;
    *c = (t - sine) / (s * t);
}

static void rotation(const double *v, double first, double second, double out[3][3]) /* 1 + first [v]x + second [v]x^2 */
{
    double k[3][3] = {{0, -v[2], v[1]}, {v[2], 0, -v[0]}, {-v[1], v[0], 0}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double square = k[i][0] * k[0][j] + k[i][1] * k[1][j] + k[i][2] * k[2][j];
            out[i][j] = (i == j) + first * k[i][j] + second * square;
        }
}

/* ------------------------------------------------------------------------------------------------ the walk */

INLINE void turn(const double (*u)[BLOCK], const double (*v)[BLOCK], const double *c, const double *s,
                 double (*restrict first)[BLOCK], double (*restrict second)[BLOCK], const int lanes) /* walk.turned */
{
    for (int i = 0; i < 3; i++)
        for (int t = 0; t < lanes; t++) {
            first[i][t] = c[t] * u[i][t] + s[t] * v[i][t];
            second[i][t] = c[t] * v[i][t] - s[t] * u[i][t];
        }
}

INLINE void fill_vector(double (*to)[BLOCK], double x, double y, double z, const int lanes)
{
    for (int t = 0; t < lanes; t++) {
        to[0][t] = x;
        to[1][t] = y;
        to[2][t] = z;
    }
}

INLINE void fill_trig(double angle, double *c, double *s, const int lanes)
{
    double cosine = cos(angle), sine = sin(angle);
    for (int t = 0; t < lanes; t++) {
        c[t] = cosine;
        s[t] = sine;
    }
}

typedef struct {
    double joint_c[BLOCK], joint_s[BLOCK], slide[BLOCK], alpha_c[BLOCK], alpha_s[BLOCK], beta_c[BLOCK], beta_s[BLOCK];
    double a;
} Link;

INLINE void link_numbers(const Arm *arm, int i, const double *row, const double *joints, int count, Link *link,
                         const int lanes)
{
    for (int t = 0; t < lanes; t++) {
        double reading = arm->sign[i] * joints[(t < count ? t : 0) * (Py_ssize_t)arm->links + i];
        link->slide[t] = arm->slides[i] ? row[1] + reading : row[1];
        if (t < count && !arm->slides[i]) {
            link->joint_c[t] = cos(row[0] + reading);
            link->joint_s[t] = sin(row[0] + reading);
        } else {
            link->joint_c[t] = t ? link->joint_c[0] : 1.0;
            link->joint_s[t] = t ? link->joint_s[0] : 0.0;
        }
    }
    if (arm->slides[i]) fill_trig(row[0], link->joint_c, link->joint_s, lanes);
    fill_trig(row[3], link->alpha_c, link->alpha_s, lanes);
    if (arm->parallel[i]) fill_trig(row[4], link->beta_c, link->beta_s, lanes);
    link->a = row[2];
}

INLINE void walk_lanes(const Arm *arm, const double *values, const double *joints, int count, Walk *w,
                       const int lanes) /* walk.along */
{
    double a, b, c, turned[3][3], turning[3][3];
    series(values[3] * values[3] + values[4] * values[4] + values[5] * values[5], &a, &b, &c);
    rotation(values + 3, a, b, turned);
    rotation(values + 3, b, c, turning);
    Vector *axes = w->axes, *origins = w->origins;
    fill_vector(origins[0], values[0], values[1], values[2], lanes);
    for (int i = 0; i < 3; i++) {
        fill_vector(axes[i], i == 0, i == 1, i == 2, lanes);
        fill_vector(axes[3 + i], turning[0][i], turning[1][i], turning[2][i], lanes);
        fill_vector(axes[6 + i], turned[0][i], turned[1][i], turned[2][i], lanes);
        w->motions[i] = (Motion){(const double (*)[BLOCK])axes[i], NULL, -1};
        w->motions[3 + i] =
            (Motion){(const double (*)[BLOCK])axes[3 + i], (const double (*)[BLOCK])origins[0], -1};
    }
    const double (*x)[BLOCK] = (const double (*)[BLOCK])axes[6], (*y)[BLOCK] = (const double (*)[BLOCK])axes[7];
    const double (*z)[BLOCK] = (const double (*)[BLOCK])axes[8], (*o)[BLOCK] = (const double (*)[BLOCK])origins[0];
    Vector *next = axes + 9, *corner = origins + 1;
    Motion *motion = w->motions + 6;
    const double *row = values + 6;
    Link link;
    for (int i = 0; i < arm->links; i++) {
        link_numbers(arm, i, row, joints, count, &link, lanes);
        for (int half = 0; half < 2; half++) {
            if ((half == 0) == arm->distal) { /* the joint, and of a distal link its length */
                motion[0] = (Motion){z, o, arm->slides[i] ? -1 : i};
                motion[1] = (Motion){z, NULL, arm->slides[i] ? i : -1};
                turn(x, y, link.joint_c, link.joint_s, next[0], next[1], lanes);
                x = (const double (*)[BLOCK])next[0];
                y = (const double (*)[BLOCK])next[1];
                next += 2;
                for (int j = 0; j < 3; j++)
                    for (int t = 0; t < lanes; t++) {
                        double along = o[j][t] + link.slide[t] * z[j][t];
                        (*corner)[j][t] = arm->distal ? along + link.a * x[j][t] : along;
                    }
                o = (const double (*)[BLOCK])(corner++)[0];
            } else { /* the link, and of a Craig link its length */
                motion[2] = (Motion){x, NULL, -1};
                motion[3] = (Motion){x, o, -1};
                turn(y, z, link.alpha_c, link.alpha_s, next[0], next[1], lanes);
                y = (const double (*)[BLOCK])next[0];
                z = (const double (*)[BLOCK])next[1];
                next += 2;
                if (!arm->distal) {
                    for (int j = 0; j < 3; j++)
                        for (int t = 0; t < lanes; t++) (*corner)[j][t] = o[j][t] + link.a * x[j][t];
                    o = (const double (*)[BLOCK])(corner++)[0];
                }
                if (arm->parallel[i]) {
                    motion[4] = (Motion){y, o, -1};
                    turn(z, x, link.beta_c, link.beta_s, next[0], next[1], lanes);
                    z = (const double (*)[BLOCK])next[0];
                    x = (const double (*)[BLOCK])next[1];
                    next += 2;
                }
            }
        }
        motion += arm->parallel[i] ? 5 : 4;
        row += arm->parallel[i] ? 5 : 4;
    }
    w->frame[0] = x;
    w->frame[1] = y;
    w->frame[2] = z;
    w->origin = o;
}

/* The lanes after the last pose repeat the first: few poses take few of them. */
WIDE static void walk(const Arm *arm, const double *values, const double *joints, int count, Walk *w)
{
    if (count <= 4)
        walk_lanes(arm, values, joints, count, w, 4);
    else if (count <= 16)
        walk_lanes(arm, values, joints, count, w, 16);
    else
        walk_lanes(arm, values, joints, count, w, BLOCK);
}

WIDE static void target_at(const Walk *w, const double *tool, int count, double (*restrict point)[BLOCK])
{ /* numpy_kernels._targets */
    for (int j = 0; j < 3; j++)
        for (int t = 0; t < count; t++)
            point[j][t] = w->origin[j][t] + tool[0] * w->frame[0][j][t] + tool[1] * w->frame[1][j][t]
                          + tool[2] * w->frame[2][j][t];
}

/* A motion's derivative at a point, axis x lever or the axis, to rows `apart` numbers apart: walk.fill. */
WIDE static void column(const Motion *motion, const double (*point)[BLOCK], double factor, int count,
                        double *restrict out, Py_ssize_t apart)
{
    const double (*axis)[BLOCK] = motion->axis, (*origin)[BLOCK] = motion->origin;
    for (int i = 0; i < 3; i++) {
        double *restrict to = out + i * apart;
        if (origin == NULL) {
            for (int t = 0; t < count; t++) to[t] = factor * axis[i][t];
            continue;
        }
        int j = (i + 1) % 3, k = (i + 2) % 3;
        const double *aj = axis[j], *ak = axis[k], *pj = point[j], *pk = point[k], *oj = origin[j], *ok = origin[k];
        for (int t = 0; t < count; t++)
            to[t] = factor * aj[t] * (pk[t] - ok[t]) - factor * ak[t] * (pj[t] - oj[t]);
    }
}

static int room(const Arm *arm, Walk *w)
{
    size_t axes = 9 + PER_LINK * (size_t)arm->links, origins = 1 + 2 * (size_t)arm->links;
    size_t motions = 6 + 5 * (size_t)arm->links;
    w->axes = malloc((axes + origins) * sizeof(Vector) + motions * sizeof(Motion));
    if (w->axes == NULL) return 0;
    w->origins = w->axes + axes;
    w->motions = (Motion *)(w->origins + origins);
    return 1;
}

/* Where positions and derivatives go: distances in numbers between coordinates, targets and rows. */
typedef struct {
    Py_ssize_t coordinate, target, row;
} Strides;

static void observe_walked(const Arm *arm, const double *values, const Walk *w, int count, double *points,
                           double *jacobian, const int64_t *slot, Strides at) /* of the poses that were walked */
{
    int before = arm->parameters - 3 * arm->targets;
    const double *tool = values + before;
    Vector point;
    for (int k = 0; k < arm->targets; k++) {
        target_at(w, tool + 3 * k, count, point);
        for (int j = 0; j < 3; j++)
            memcpy(points + j * at.coordinate + k * at.target, point[j], count * sizeof(double));
        if (jacobian == NULL) continue;
        double *own = jacobian + k * at.target;
        for (int m = 0; m < before; m++)
            if (slot[m] >= 0)
                column(w->motions + m, (const double (*)[BLOCK])point, 1.0, count, own + slot[m] * at.row,
                       at.coordinate);
        for (int i = 0; i < 3 * arm->targets; i++) { /* another target's position moves this one nowhere */
            int64_t row = slot[before + i];
            for (int j = 0; j < 3 && row >= 0; j++) {
                double *to = own + row * at.row + j * at.coordinate;
                if (i / 3 == k)
                    memcpy(to, w->frame[i % 3][j], count * sizeof(double));
                else
                    memset(to, 0, count * sizeof(double));
            }
        }
    }
}

static void observe_one(const Arm *arm, const double *values, const double *joints, Py_ssize_t n, Walk *w,
                        double *points, double *jacobian, const int64_t *slot, Strides at)
{
    for (Py_ssize_t first = 0; first < n; first += BLOCK) {
        int count = n - first < BLOCK ? (int)(n - first) : BLOCK;
        walk(arm, values, joints + first * arm->links, count, w);
        observe_walked(arm, values, w, count, points + first, jacobian == NULL ? NULL : jacobian + first, slot, at);
    }
}

/* How a motion turns the last frame, its axis or nothing, times matrices, to rows `apart` numbers apart. */
WIDE static void turned_axis(const Motion *motion, const double (*by)[3][BLOCK], int count, double *restrict out,
                             Py_ssize_t apart)
{
    const double (*axis)[BLOCK] = motion->axis;
    for (int i = 0; i < 3; i++) {
        double *restrict to = out + i * apart;
        if (motion->origin == NULL) {
            memset(to, 0, count * sizeof(double));
            continue;
        }
        for (int t = 0; t < count; t++)
            to[t] = by[i][0][t] * axis[0][t] + by[i][1][t] * axis[1][t] + by[i][2][t] * axis[2][t];
    }
}

/* ------------------------------------------------------------------------------------------------ from Python */

typedef struct {
    Py_buffer views[12];
    int count;
} Views;

static void let_go(Views *held)
{
    while (held->count) PyBuffer_Release(&held->views[--held->count]);
}

/* The numbers of an array (8 bytes each; 1 byte of flags), or NULL with an error set. */
static void *numbers(Views *held, PyObject *from, int writable, Py_ssize_t item, Py_ssize_t *count)
{
    Py_buffer *view = &held->views[held->count];
    if (PyObject_GetBuffer(from, view, PyBUF_C_CONTIGUOUS | (writable ? PyBUF_WRITABLE : 0)) < 0) return NULL;
    held->count++;
    if (view->itemsize != item) {
        PyErr_SetString(PyExc_ValueError, "an array of another kind of number");
        return NULL;
    }
    *count = view->len / item;
    return view->buf == NULL ? (void *)view : view->buf;
}

static PyObject *wrong(Views *held)
{
    let_go(held);
    if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "arrays of sizes that do not belong together");
    return NULL;
}

/* The arm from shape (3 + 2 links) and sign (links): distal, links, targets, then slides, then parallel. */
static int read_arm(Views *held, PyObject *shape, PyObject *sign, Arm *arm)
{
    Py_ssize_t size, signs;
    const int64_t *given = numbers(held, shape, 0, 8, &size);
    arm->sign = given == NULL ? NULL : numbers(held, sign, 0, 8, &signs);
    if (arm->sign == NULL || size < 3 || size != 3 + 2 * given[1] || signs != given[1]) return 0;
    arm->distal = (int)given[0];
    arm->links = (int)given[1];
    arm->targets = (int)given[2];
    arm->slides = given + 3;
    arm->parallel = arm->slides + arm->links;
    arm->parameters = 6 + 3 * arm->targets;
    for (int i = 0; i < arm->links; i++) arm->parameters += arm->parallel[i] ? 5 : 4;
    return 1;
}

static int most_slot(const int64_t *slot, Py_ssize_t count, Py_ssize_t rows)
{
    for (Py_ssize_t i = 0; i < count; i++)
        if (slot[i] >= rows) return 0;
    return 1;
}

/* observe(shape, sign, values, joints, slot, points, jacobian): numpy_kernels.points and .observe. */
static PyObject *observe(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Arm arm;
    Walk w;
    Py_ssize_t p, read, slots, out, rows;
    if (given != 7 || !read_arm(&held, args[0], args[1], &arm)) return wrong(&held);
    const double *values, *joints;
    const int64_t *slot;
    double *points, *jacobian;
    if (!(values = numbers(&held, args[2], 0, 8, &p)) || !(joints = numbers(&held, args[3], 0, 8, &read))
        || !(slot = numbers(&held, args[4], 0, 8, &slots)) || !(points = numbers(&held, args[5], 1, 8, &out))
        || !(jacobian = numbers(&held, args[6], 1, 8, &rows)))
        return wrong(&held);
    Py_ssize_t n = read / arm.links, one = 3 * (Py_ssize_t)arm.targets * n;
    if (p != arm.parameters || read != n * arm.links || out != one || slots != p) return wrong(&held);
    if (one && (rows % one || !most_slot(slot, slots, rows / one)) && rows) return wrong(&held);
    if (!room(&arm, &w)) {
        let_go(&held);
        return PyErr_NoMemory();
    }
    Strides at = {arm.targets * n, n, one};
    PyThreadState *state = n > RELEASE ? PyEval_SaveThread() : NULL;
    observe_one(&arm, values, joints, n, &w, points, rows ? jacobian : NULL, slot, at);
    if (state) PyEval_RestoreThread(state);
    free(w.axes);
    let_go(&held);
    Py_RETURN_NONE;
}

static void vector_of(double r[3][3], double out[3]) /* se3.log */
{
    double q[4];
    double square[4] = {1 + r[0][0] + r[1][1] + r[2][2], 1 + r[0][0] - r[1][1] - r[2][2],
                        1 - r[0][0] + r[1][1] - r[2][2], 1 - r[0][0] - r[1][1] + r[2][2]};
    double skew[3] = {r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]};
    int pivot = 0;
    for (int i = 1; i < 4; i++)
        if (square[i] > square[pivot]) pivot = i;
    q[0] = pivot ? skew[pivot - 1] : square[0];
    for (int i = 0; i < 3; i++)
        q[1 + i] = pivot == 0 ? skew[i] : pivot == 1 + i ? square[pivot] : r[i][pivot - 1] + r[pivot - 1][i];
    double size = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) * (q[0] < 0 ? -1 : 1);
    for (int i = 0; i < 4; i++) q[i] /= size;
    double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), angle = 2 * atan2(sine, q[0]);
    for (int i = 0; i < 3; i++) out[i] = (sine < 1e-12 ? 2.0 : angle / sine) * q[1 + i];
}

static void product(double a[3][3], double b[3][3], double out[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            out[i][j] = 0.0;
            for (int k = 0; k < 3; k++) out[i][j] += a[i][k] * b[k][j];
        }
}

static void turned_back(const double *quaternion, double out[3][3]) /* se3.rotation_from_quaternion, transposed */
{
    double size = 0.0, v[3];
    for (int i = 0; i < 4; i++) size += quaternion[i] * quaternion[i];
    size = sqrt(size);
    for (int i = 0; i < 3; i++) v[i] = -quaternion[1 + i] / size;
    rotation(v, 2 * quaternion[0] / size, 2.0, out);
}

/* How a small rotation of the predicted frame moves v = log(R_measured' R): J_l(v)^-1 R_measured'. */
static void error_rates(const double *v, double back[3][3], double out[3][3])
{
    double a, b, c, inverse[3][3], s = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    series(s, &a, &b, &c);
    double half = s < 1e-4 ? (1 + s / 60 * (1 + s / 42)) / 12 : (1 - a / (2 * b)) / s;
    rotation(v, -0.5, half, inverse);
    product(inverse, back, out);
}

/* oriented(shape, sign, values, turn, quaternions, joints, points, jacobian): full_pose.Poses._points and ._observe.
 *
 * turn (3,), quaternions (n, 4); points (3, k + 1, n) with the rotation's error last, jacobian (p + 3, 3, k + 1, n). */
static PyObject *oriented(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Arm arm;
    Walk w;
    Py_ssize_t p, three, four, read, out, size;
    if (given != 8 || !read_arm(&held, args[0], args[1], &arm)) return wrong(&held);
    const double *values, *turn, *quaternions, *joints;
    double *points, *jacobian;
    if (!(values = numbers(&held, args[2], 0, 8, &p)) || !(turn = numbers(&held, args[3], 0, 8, &three))
        || !(quaternions = numbers(&held, args[4], 0, 8, &four)) || !(joints = numbers(&held, args[5], 0, 8, &read))
        || !(points = numbers(&held, args[6], 1, 8, &out)) || !(jacobian = numbers(&held, args[7], 1, 8, &size)))
        return wrong(&held);
    Py_ssize_t n = read / arm.links, many = 1 + (Py_ssize_t)arm.targets, one = 3 * many * n;
    if (p != arm.parameters || three != 3 || read != n * arm.links || four != 4 * n || out != one
        || (size && size != (p + 3) * one))
        return wrong(&held);
    int64_t *slot = malloc((size_t)p * sizeof(int64_t));
    if (slot == NULL || !room(&arm, &w)) {
        free(slot);
        let_go(&held);
        return PyErr_NoMemory();
    }
    for (Py_ssize_t i = 0; i < p; i++) slot[i] = i;
    PyThreadState *state = n > RELEASE ? PyEval_SaveThread() : NULL;
    Strides at = {many * n, n, one};
    int before = arm.parameters - 3 * arm.targets;
    double a, b, c, tool[3][3], turning[3][3];
    series(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2], &a, &b, &c);
    rotation(turn, a, b, tool);
    rotation(turn, b, c, turning);
    double rates[3][3][BLOCK];
    for (Py_ssize_t first = 0; first < n; first += BLOCK) {
        int count = n - first < BLOCK ? (int)(n - first) : BLOCK;
        walk(&arm, values, joints + first * arm.links, count, &w);
        observe_walked(&arm, values, &w, count, points + first, size ? jacobian + first : NULL, slot, at);
        double *own = size ? jacobian + arm.targets * n + first : NULL;
        for (int t = 0; t < count; t++) {
            double back[3][3], frame[3][3], between[3][3], predicted[3][3], v[3], by[3][3], last[3][3];
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) frame[i][j] = w.frame[j][i][t];
            turned_back(quaternions + 4 * (first + t), back);
            product(back, frame, between);
            product(between, tool, predicted);
            vector_of(predicted, v);
            for (int i = 0; i < 3; i++) points[i * at.coordinate + arm.targets * n + first + t] = v[i];
            if (own == NULL) continue;
            error_rates(v, back, by);
            product(by, frame, between);
            product(between, turning, last);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    rates[i][j][t] = by[i][j];
                    own[(p + j) * one + i * at.coordinate + t] = last[i][j];
                }
        }
        if (own == NULL) continue;
        for (int m = 0; m < before; m++)
            turned_axis(w.motions + m, (const double (*)[3][BLOCK])rates, count, own + m * one, at.coordinate);
        for (int i = 0; i < 3; i++)
            for (int m = before; m < p; m++) /* where a target is turns nothing */
                memset(own + m * one + i * at.coordinate, 0, count * sizeof(double));
        for (int j = 0; j < 3; j++) /* how the frame is turned moves no target */
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < arm.targets; k++)
                    memset(jacobian + (p + j) * one + i * at.coordinate + k * n + first, 0, count * sizeof(double));
    }
    if (state) PyEval_RestoreThread(state);
    free(slot);
    free(w.axes);
    let_go(&held);
    Py_RETURN_NONE;
}

/* stacked(shape, sign, values, joints, slot, points, jacobian): numpy_kernels.points_stacked and .observe_stacked, (b, ., k, 3, n). */
static PyObject *stacked(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Arm arm;
    Walk w;
    Py_ssize_t p, read, slots, out, size;
    if (given != 7 || !read_arm(&held, args[0], args[1], &arm)) return wrong(&held);
    const double *values, *joints;
    const int64_t *slot;
    double *points, *jacobian;
    if (!(values = numbers(&held, args[2], 0, 8, &p)) || !(joints = numbers(&held, args[3], 0, 8, &read))
        || !(slot = numbers(&held, args[4], 0, 8, &slots)) || !(points = numbers(&held, args[5], 1, 8, &out))
        || !(jacobian = numbers(&held, args[6], 1, 8, &size)))
        return wrong(&held);
    Py_ssize_t arms = p / arm.parameters, n = read / arm.links;
    if (arms && out != 3 * arm.targets * arms * n) { /* joint positions of each arm's own */
        n /= arms;
        if (read != arms * n * arm.links) return wrong(&held);
    }
    Py_ssize_t one = 3 * (Py_ssize_t)arm.targets * n, own = read == n * arm.links ? 0 : n * arm.links;
    if (p != arms * arm.parameters || out != arms * one || slots != arm.parameters) return wrong(&held);
    Py_ssize_t rows = (arms && one) ? size / (arms * one) : 0;
    if (size != rows * arms * one || (rows && !most_slot(slot, slots, rows))) return wrong(&held);
    if (!room(&arm, &w)) {
        let_go(&held);
        return PyErr_NoMemory();
    }
    Strides at = {n, 3 * n, one};
    PyThreadState *state = arms * n > RELEASE ? PyEval_SaveThread() : NULL;
    for (Py_ssize_t b = 0; b < arms; b++)
        observe_one(&arm, values + b * arm.parameters, joints + b * own, n, &w, points + b * one,
                    rows ? jacobian + b * rows * one : NULL, slot, at);
    if (state) PyEval_RestoreThread(state);
    free(w.axes);
    let_go(&held);
    Py_RETURN_NONE;
}

/* tool(shape, sign, values, joints, target, Ts, jacobian): numpy_kernels.tool, (n, 4, 4) and (6, joints, n). */
static PyObject *tool(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Arm arm;
    Walk w;
    Py_ssize_t p, read, out, size;
    if (given != 7 || !read_arm(&held, args[0], args[1], &arm)) return wrong(&held);
    const double *values, *joints;
    double *Ts, *jacobian;
    long target = PyLong_AsLong(args[4]);
    if (PyErr_Occurred() || !(values = numbers(&held, args[2], 0, 8, &p))
        || !(joints = numbers(&held, args[3], 0, 8, &read)) || !(Ts = numbers(&held, args[5], 1, 8, &out))
        || !(jacobian = numbers(&held, args[6], 1, 8, &size)))
        return wrong(&held);
    Py_ssize_t n = read / arm.links;
    if (p != arm.parameters || read != n * arm.links || out != 16 * n || size != 6 * n * arm.links || target < 0
        || target >= arm.targets)
        return wrong(&held);
    if (!room(&arm, &w)) {
        let_go(&held);
        return PyErr_NoMemory();
    }
    PyThreadState *state = n > RELEASE ? PyEval_SaveThread() : NULL;
    int before = arm.parameters - 3 * arm.targets;
    Vector point;
    Py_ssize_t apart = arm.links * n;
    for (Py_ssize_t first = 0; first < n; first += BLOCK) {
        int count = n - first < BLOCK ? (int)(n - first) : BLOCK;
        walk(&arm, values, joints + first * arm.links, count, &w);
        target_at(&w, values + before + 3 * target, count, point);
        for (int t = 0; t < count; t++) {
            double *T = Ts + 16 * (first + t);
            for (int i = 0; i < 3; i++) {
                for (int j = 0; j < 3; j++) T[4 * i + j] = w.frame[j][i][t];
                T[4 * i + 3] = point[i][t];
                T[12 + i] = 0.0;
            }
            T[15] = 1.0;
        }
        for (int m = 6; m < before; m++) {
            const Motion *motion = w.motions + m;
            if (motion->joint < 0) continue;
            double sign = arm.sign[motion->joint], *to = jacobian + motion->joint * n + first;
            column(motion, (const double (*)[BLOCK])point, sign, count, to, apart);
            for (int i = 0; i < 3; i++)
                for (int t = 0; t < count; t++)
                    to[(3 + i) * apart + t] = motion->origin == NULL ? 0.0 : sign * motion->axis[i][t];
        }
    }
    if (state) PyEval_RestoreThread(state);
    free(w.axes);
    let_go(&held);
    Py_RETURN_NONE;
}

/* ------------------------------------------------------------------------------------------------ Newton's method */

#define MAX_STEPS 40       /* newton.MAX_STEPS and those that follow there; differential.ROTATION_M */
#define ARRIVED 1e-10
#define LONGEST_STEP 0.3
#define LEAST_DAMPING 1e-6
#define LARGEST_DAMPING 1e3
#define ROTATION_M 0.3

static void missing_rotation(const double *wanted, const Walk *w, int t, double out[3]) /* se3.log(wanted R') */
{
    double r[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            r[i][j] = 0.0;
            for (int k = 0; k < 3; k++) r[i][j] += wanted[3 * i + k] * w->frame[k][j][t];
        }
    vector_of(r, out);
}

static void eliminate(double a[6][7]) /* a x = b with the right side in the last column, where x is left */
{
    for (int k = 0; k < 6; k++) {
        int pivot = k;
        for (int i = k + 1; i < 6; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
        for (int j = k; j < 7 && pivot != k; j++) {
            double held = a[k][j];
            a[k][j] = a[pivot][j];
            a[pivot][j] = held;
        }
        for (int i = k + 1; i < 6; i++) {
            double factor = a[i][k] / a[k][k];
            for (int j = k + 1; j < 7; j++) a[i][j] -= factor * a[k][j];
        }
    }
    for (int i = 5; i >= 0; i--) {
        for (int j = i + 1; j < 6; j++) a[i][6] -= a[i][j] * a[j][6];
        a[i][6] /= a[i][i];
    }
}

/* newton.shortest_step of one pose: jacobian (6, links), to the joints it leads to. */
static void step_from(const double *joints, const double *jacobian, const double *errors, int turned, double damping,
                      int links, double *moved)
{
    double weight[6] = {1, 1, 1, ROTATION_M, ROTATION_M, ROTATION_M}, a[6][7], longest = 1e-300;
    for (int i = 0; i < 6; i++) {
        if (i > 2 && !turned) weight[i] = 0.0;
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < links; k++) sum += jacobian[i * links + k] * jacobian[j * links + k];
            a[i][j] = a[j][i] = weight[i] * weight[j] * sum;
        }
        a[i][i] += damping * damping + (weight[i] > 0 ? 1e-15 : 1.0);
        a[i][6] = weight[i] * errors[i];
    }
    eliminate(a);
    for (int k = 0; k < links; k++) {
        moved[k] = 0.0;
        for (int i = 0; i < 6; i++) moved[k] += weight[i] * jacobian[i * links + k] * a[i][6];
        if (fabs(moved[k]) > longest) longest = fabs(moved[k]);
    }
    for (int k = 0; k < links; k++) moved[k] = joints[k] + moved[k] * fmin(1.0, LONGEST_STEP / longest);
}

static double size_of(const double *errors, double rotation)
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        sum += errors[i] * errors[i] + rotation * rotation * errors[3 + i] * errors[3 + i];
    return sqrt(sum);
}

static int arrived(const double *e)
{
    return sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) < ARRIVED
           && sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]) < ARRIVED;
}

typedef struct {
    const double *values, *tool, *start, *positions, *rotations;
    double *joints, *errors;
    int64_t *steps;
    Py_ssize_t n;
} Wanted;

/* Some poses at a time, each in a lane of the walk; the next pose takes the lane of one that has ended. */
static void reach_all(const Arm *arm, const Wanted *of, Walk *w, double *held, double *moved, double *ahead)
{
    Py_ssize_t row[BLOCK], next = 0;
    int links = arm->links, lanes = 0, fresh[BLOCK], turned[BLOCK], before = arm->parameters - 3 * arm->targets;
    double damping[BLOCK], there[6];
    Vector point;
    for (;;) {
        for (; lanes < BLOCK && next < of->n; lanes++, next++) {
            row[lanes] = next;
            fresh[lanes] = turned[lanes] = 1;
            for (int i = 0; i < 9; i++) turned[lanes] &= isfinite(of->rotations[9 * next + i]) != 0;
            damping[lanes] = 0.0;
            of->steps[next] = 0;
            memcpy(moved + lanes * links, of->start + next * links, links * sizeof(double));
        }
        if (!lanes) return;
        walk(arm, of->values, moved, lanes, w);
        target_at(w, of->tool, lanes, point);
        for (int m = 6; m < before; m++) {
            const Motion *motion = w->motions + m;
            if (motion->joint < 0) continue;
            double sign = arm->sign[motion->joint], *to = ahead + motion->joint * BLOCK;
            column(motion, (const double (*)[BLOCK])point, sign, lanes, to, links * BLOCK);
            for (int i = 0; i < 3; i++)
                for (int t = 0; t < lanes; t++)
                    to[(3 + i) * links * BLOCK + t] = motion->origin == NULL ? 0.0 : sign * motion->axis[i][t];
        }
        for (int t = lanes - 1; t >= 0; t--) {
            Py_ssize_t r = row[t];
            double *joints = of->joints + r * links, *errors = of->errors + 6 * r, *jacobian = held + t * 6 * links;
            for (int i = 0; i < 3; i++) there[i] = of->positions[3 * r + i] - point[i][t];
            there[3] = there[4] = there[5] = 0.0;
            if (turned[t]) missing_rotation(of->rotations + 9 * r, w, t, there + 3);
            int better = fresh[t] || size_of(there, ROTATION_M) < size_of(errors, ROTATION_M);
            if (better) {
                memcpy(joints, moved + t * links, links * sizeof(double));
                memcpy(errors, there, sizeof there);
                for (int i = 0; i < 6 * links; i++) jacobian[i] = ahead[i * BLOCK + t];
            }
            if (!fresh[t]) {
                damping[t] = better ? (damping[t] > LEAST_DAMPING ? damping[t] / 10 : 0.0)
                                    : fmax(10 * damping[t], LEAST_DAMPING);
                of->steps[r]++;
            }
            fresh[t] = 0;
            if (!arrived(errors) && damping[t] <= LARGEST_DAMPING && of->steps[r] < MAX_STEPS) {
                step_from(joints, jacobian, errors, turned[t], damping[t], links, moved + t * links);
                continue;
            }
            int last = --lanes; /* whose step is taken already */
            if (last == t) continue;
            row[t] = row[last];
            fresh[t] = fresh[last];
            turned[t] = turned[last];
            damping[t] = damping[last];
            memcpy(moved + t * links, moved + last * links, links * sizeof(double));
            memcpy(jacobian, held + last * 6 * links, 6 * links * sizeof(double));
        }
    }
}

/* reach(shape, sign, values, start, positions, rotations, target, joints, errors, steps): newton.reach of 6 joints and
 * more. */
static PyObject *reach(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Arm arm;
    Walk w;
    Wanted of;
    Py_ssize_t p, read, places, turns, out, missing, counts;
    if (given != 10 || !read_arm(&held, args[0], args[1], &arm)) return wrong(&held);
    long target = PyLong_AsLong(args[6]);
    if (PyErr_Occurred() || !(of.values = numbers(&held, args[2], 0, 8, &p))
        || !(of.start = numbers(&held, args[3], 0, 8, &read)) || !(of.positions = numbers(&held, args[4], 0, 8, &places))
        || !(of.rotations = numbers(&held, args[5], 0, 8, &turns)) || !(of.joints = numbers(&held, args[7], 1, 8, &out))
        || !(of.errors = numbers(&held, args[8], 1, 8, &missing))
        || !(of.steps = numbers(&held, args[9], 1, 8, &counts)))
        return wrong(&held);
    Py_ssize_t n = of.n = counts;
    if (p != arm.parameters || arm.links < 6 || read != n * arm.links || out != read || places != 3 * n || turns != 9 * n
        || missing != 6 * n || target < 0 || target >= arm.targets)
        return wrong(&held);
    of.tool = of.values + arm.parameters - 3 * arm.targets + 3 * target;
    size_t own = (size_t)arm.links * BLOCK;
    double *space = malloc(13 * own * sizeof(double));
    if (space == NULL || !room(&arm, &w)) {
        free(space);
        let_go(&held);
        return PyErr_NoMemory();
    }
    PyThreadState *state = n > RELEASE ? PyEval_SaveThread() : NULL;
    reach_all(&arm, &of, &w, space, space + 6 * own, space + 7 * own);
    if (state) PyEval_RestoreThread(state);
    free(w.axes);
    free(space);
    let_go(&held);
    Py_RETURN_NONE;
}

/* ------------------------------------------------------------------------------------------------ linear algebra */

/* The inner product of n numbers, as four sums that go side by side. */
INLINE double inner(const double *restrict a, const double *restrict b, Py_ssize_t n)
{
    double part[4] = {0, 0, 0, 0}, rest = 0;
    Py_ssize_t t = 0;
    for (; t + 4 <= n; t += 4)
        for (int j = 0; j < 4; j++) part[j] += a[t + j] * b[t + j];
    for (; t < n; t++) rest += a[t] * b[t];
    return rest + ((part[0] + part[1]) + (part[2] + part[3]));
}

/* independent(columns, rows, order, tolerance, kept): gauge._gram_schmidt, Gram-Schmidt done twice where the
 * first time leaves little. columns (p, rows); order (m,) of them; kept (m,), written: 1 where those before do not
 * span it. */
WIDE static double without(const double *restrict basis, Py_ssize_t known, Py_ssize_t rows, double *restrict rest)
{
    double left = 0;
    for (int twice = 0; twice < 2 && left <= 0.1; twice++) {
        for (Py_ssize_t i = 0; i < known; i++) {
            const double *q = basis + i * rows, share = inner(q, rest, rows);
            for (Py_ssize_t t = 0; t < rows; t++) rest[t] -= share * q[t];
        }
        left = sqrt(inner(rest, rest, rows));
    }
    return left;
}

static PyObject *independent(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Py_ssize_t size, m, out, known = 0;
    const double *columns;
    const int64_t *order;
    int64_t *kept;
    if (given != 5) return wrong(&held);
    Py_ssize_t rows = PyLong_AsSsize_t(args[1]);
    double tolerance = PyFloat_AsDouble(args[3]);
    if (PyErr_Occurred() || !(columns = numbers(&held, args[0], 0, 8, &size))
        || !(order = numbers(&held, args[2], 0, 8, &m)) || !(kept = numbers(&held, args[4], 1, 8, &out)))
        return wrong(&held);
    if (rows < 0 || out != m || (rows && size % rows)) return wrong(&held);
    for (Py_ssize_t i = 0; i < m; i++)
        if (order[i] < 0 || (order[i] + 1) * rows > size) return wrong(&held);
    double *basis = malloc((m * rows + 1) * sizeof(double));
    if (basis == NULL) {
        let_go(&held);
        return PyErr_NoMemory();
    }
    for (Py_ssize_t i = 0; i < m; i++) {
        double *rest = basis + known * rows;
        const double *column = columns + order[i] * rows;
        double norm = sqrt(inner(column, column, rows));
        kept[i] = 0;
        if (!(norm > tolerance)) continue;
        for (Py_ssize_t t = 0; t < rows; t++) rest[t] = column[t] / norm;
        double left = without(basis, known, rows, rest);
        kept[i] = left > tolerance;
        if (!kept[i]) continue;
        for (Py_ssize_t t = 0; t < rows; t++) rest[t] /= left;
        known++;
    }
    free(basis);
    let_go(&held);
    Py_RETURN_NONE;
}

/* cholesky(normal, right, step): x of A x = b for matrices (b, f, f), positive definite; False where one is not.
 * Only the lower half of each matrix is read. */
WIDE static int solved(const double *restrict a, const double *restrict right, Py_ssize_t f, double *restrict l,
                       double *restrict x)
{
    for (Py_ssize_t i = 0; i < f; i++) {
        for (Py_ssize_t j = 0; j <= i; j++) {
            double sum = a[i * f + j] - inner(l + i * f, l + j * f, j);
            if (i == j) {
                if (!(sum > 0)) return 0;
                l[i * f + i] = sqrt(sum);
            } else
                l[i * f + j] = sum / l[j * f + j];
        }
    }
    for (Py_ssize_t i = 0; i < f; i++) {
        double sum = right[i];
        for (Py_ssize_t k = 0; k < i; k++) sum -= l[i * f + k] * x[k];
        x[i] = sum / l[i * f + i];
    }
    for (Py_ssize_t i = f - 1; i >= 0; i--) {
        x[i] /= l[i * f + i];
        for (Py_ssize_t k = 0; k < i; k++) x[k] -= l[i * f + k] * x[i];
    }
    return 1;
}

static PyObject *cholesky(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Py_ssize_t size, rights, out, all = 1;
    const double *normal, *right;
    double *step;
    if (given != 4) return wrong(&held);
    Py_ssize_t f = PyLong_AsSsize_t(args[1]);
    if (PyErr_Occurred() || !(normal = numbers(&held, args[0], 0, 8, &size))
        || !(right = numbers(&held, args[2], 0, 8, &rights)) || !(step = numbers(&held, args[3], 1, 8, &out)))
        return wrong(&held);
    if (f < 1 || rights != out || rights % f || size != rights * f) return wrong(&held);
    double *l = malloc(f * f * sizeof(double));
    if (l == NULL) {
        let_go(&held);
        return PyErr_NoMemory();
    }
    for (Py_ssize_t b = 0; b * f < rights && all; b++)
        all = solved(normal + b * f * f, right + b * f, f, l, step + b * f);
    free(l);
    let_go(&held);
    return PyBool_FromLong((long)all);
}

#include "inverse.c"
#include "shared_errors.c"

static PyMethodDef methods[] = {
    {"cholesky", (PyCFunction)(void (*)(void))cholesky, METH_FASTCALL, NULL},
    {"independent", (PyCFunction)(void (*)(void))independent, METH_FASTCALL, NULL},
    {"innovations", (PyCFunction)(void (*)(void))innovations, METH_FASTCALL, NULL},
    {"inverse", (PyCFunction)(void (*)(void))inverse, METH_FASTCALL, NULL},
    {"observe", (PyCFunction)(void (*)(void))observe, METH_FASTCALL, NULL},
    {"planar_frame", (PyCFunction)(void (*)(void))planar_frame, METH_FASTCALL, NULL},
    {"reach", (PyCFunction)(void (*)(void))reach, METH_FASTCALL, NULL},
    {"oriented", (PyCFunction)(void (*)(void))oriented, METH_FASTCALL, NULL},
    {"settle", (PyCFunction)(void (*)(void))settle, METH_FASTCALL, NULL},
    {"stacked", (PyCFunction)(void (*)(void))stacked, METH_FASTCALL, NULL},
    {"three_parallel", (PyCFunction)(void (*)(void))three_parallel, METH_FASTCALL, NULL},
    {"three_joints", (PyCFunction)(void (*)(void))three_joints, METH_FASTCALL, NULL},
    {"tool", (PyCFunction)(void (*)(void))tool, METH_FASTCALL, NULL},
    {"whiten", (PyCFunction)(void (*)(void))whiten, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "machine_code", NULL, -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit_machine_code(void)
{
    PyObject *made = PyModule_Create(&module);
    if (made && PyModule_AddIntConstant(made, "VERSION", VERSION) < 0) {
        Py_DECREF(made);
        return NULL;
    }
    return made;
}
