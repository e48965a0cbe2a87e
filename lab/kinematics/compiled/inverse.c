/* Closed forms of the inverse in machine code, a part of kernels.c: what the numpy code that each comment names does.
 *
 * The numbers of an arm come in the order of the struct that they are read as.
 */

/* ------------------------------------------------------------------------------------------------ a spherical wrist */

#define TINY 1e-13     /* khalil_one_unknown.TINY and .ROUNDING, first_three_joints.BEND */
#define ROUNDING 1e-12
#define BEND 0.03

typedef struct { /* in the order of SphericalWrist's numbers */
    double sign[6], centre[3], root[3], parts[27], rows[9], axis_5[3], axis_6[3];
    double bend, offset, shoulder[2], upper, upper_bent, fore, fore_bent, turning;
} Wrist;

/* X sin t + Y cos t = Z: two roots, the gap, and whether t is free. */
INLINE void type_2(double x, double y, double z, double liked, double root[2], double *gap, unsigned char *free_)
{
    double size = sqrt(x * x + y * y), missing = fabs(z) - size;
    *free_ = size <= TINY;
    *gap = missing <= ROUNDING * size + TINY ? 0.0 : missing;
    double height = *gap > 0 ? (z > 0 ? size : z < 0 ? -size : 0.0) : z;
    double square = (size - fabs(height)) * (size + fabs(height)), rest = square > 0 ? sqrt(square) : 0.0;
    root[0] = *free_ ? liked : atan2(x * height + y * rest, y * height - x * rest);
    root[1] = *free_ ? liked : atan2(x * height - y * rest, y * height + x * rest);
}

/* X sin t + Y cos t = 0: the cosine and the sine of its first root, half a turn before the second. */
INLINE void across(double x, double y, double liked, double *c, double *s, unsigned char *free_)
{
    double size = sqrt(x * x + y * y);
    *free_ = size <= TINY;
    *c = *free_ ? cos(liked) : -x / size;
    *s = *free_ ? sin(liked) : y / size;
}

/* X cos i + Y cos(i + j) = Z1, X sin i + Y sin(i + j) = Z2, both lengths positive: two pairs of roots. */
INLINE void type_8(double x, double y, double z1, double z2, double liked, double i[2], double j[2], double *gap,
                   unsigned char *free_)
{
    double reach = sqrt(z1 * z1 + z2 * z2), longest = x + y, shortest = fabs(x - y);
    double outside = reach - longest, inside = shortest - reach;
    *gap = outside > inside ? outside : inside;
    if (*gap <= ROUNDING * longest + TINY) *gap = 0.0;
    double stretched = -outside * (reach + longest), folded = -inside * (reach + shortest);
    double corner = 2 * atan2(sqrt(stretched > 0 ? stretched : 0.0), sqrt(folded > 0 ? folded : 0.0));
    if (*gap > 0) corner = corner < BEND ? BEND : corner > M_PI - BEND ? M_PI - BEND : corner;
    double along = x + y * cos(corner), across = y * sin(corner);
    *free_ = reach <= TINY;
    j[0] = corner;
    j[1] = -corner;
    i[0] = *free_ ? liked : atan2(along * z2 - across * z1, along * z1 + across * z2);
    i[1] = *free_ ? liked : atan2(along * z2 + across * z1, along * z1 - across * z2);
}

INLINE void times(const double *matrix, int rows, const double *vector, double *out)
{
    for (int i = 0; i < rows; i++)
        out[i] = matrix[3 * i] * vector[0] + matrix[3 * i + 1] * vector[1] + matrix[3 * i + 2] * vector[2];
}

INLINE double wrapped(double angle)
{
    return angle - 2 * M_PI * rint(angle / (2 * M_PI));
}

/* A vector, split by joint 1's parts, turned back by joint 1 and by the turn about w, along the wrist's axes. */
INLINE void in_wrist(const Wrist *w, const double split[9], double c1, double s1, double cl, double sl, double out[3])
{
    double plane[3], back[3];
    for (int i = 0; i < 3; i++) plane[i] = split[i] + c1 * split[3 + i] - s1 * split[6 + i];
    back[0] = cl * plane[0] + sl * plane[1];
    back[1] = cl * plane[1] - sl * plane[0];
    back[2] = plane[2];
    times(w->rows, 3, back, out);
}

INLINE void inverse_one(const Wrist *w, const double *T, const double *reference, double *joints, double *gaps,
                        unsigned char *free_)
{
    double R[9], position[3], centre[3], split[9], ahead[3], split_5[9], split_6[9], liked[6];
    for (int i = 0; i < 6; i++) liked[i] = reference ? reference[i] * w->sign[i] : 0.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[3 * i + j] = T[4 * i + j];
    times(R, 3, w->centre, centre);
    for (int i = 0; i < 3; i++) position[i] = centre[i] + T[4 * i + 3] - w->root[i];
    times(w->parts, 9, position, split);
    times(R, 3, w->axis_5, ahead);
    times(w->parts, 9, ahead, split_5);
    times(R, 3, w->axis_6, ahead);
    times(w->parts, 9, ahead, split_6);
    double first[2], gap_1, gap_8, shoulder[2], elbow[2], bent = w->upper_bent, fore_bent = w->fore_bent;
    unsigned char first_free, shoulder_free, wrist_free;
    type_2(-split[8], split[5], w->offset - split[2], liked[0], first, &gap_1, &first_free);
    for (int a = 0; a < 2; a++) {
        double c1 = cos(first[a]), s1 = sin(first[a]);
        double e = split[0] + c1 * split[3] - s1 * split[6], f = split[1] + c1 * split[4] - s1 * split[7];
        type_8(w->upper, w->fore, e - w->shoulder[0], f - w->shoulder[1], liked[1] + bent, shoulder, elbow, &gap_8,
               &shoulder_free);
        for (int b = 0; b < 2; b++) {
            double lifted = shoulder[b] + elbow[b] - fore_bent, cl = cos(lifted), sl = sin(lifted);
            double five[3], six[3], c4, s4;
            in_wrist(w, split_6, c1, s1, cl, sl, six);
            in_wrist(w, split_5, c1, s1, cl, sl, five);
            across(six[2], six[1], liked[3], &c4, &s4, &wrist_free);
            double sin_5 = six[1] * s4 - six[2] * c4, fourth = wrist_free ? liked[3] : atan2(s4, c4);
            double fifth = atan2(sin_5, six[0]);
            double sixth = atan2(sin_5 * five[0] + six[0] * (five[2] * c4 - five[1] * s4), five[1] * c4 + five[2] * s4);
            for (int c = 0; c < 2; c++) {
                int branch = 4 * c + 2 * b + a, turned = c && !wrist_free; /* by half a turn of joint 4 */
                double *q = joints + 6 * branch;
                q[0] = first[a];
                q[1] = shoulder[b] - bent;
                q[2] = w->turning * (elbow[b] + bent - fore_bent);
                q[3] = turned ? fourth - M_PI : fourth;
                q[4] = w->bend + (turned ? -fifth : fifth);
                q[5] = turned ? sixth - M_PI : sixth;
                for (int i = 0; i < 6; i++) q[i] = w->sign[i] * wrapped(q[i]);
                gaps[branch] = gap_1 > gap_8 ? gap_1 : gap_8;
                unsigned char flags[6] = {first_free, shoulder_free, 0, wrist_free, 0, 0};
                memcpy(free_ + 6 * branch, flags, 6);
            }
        }
    }
}

WIDE static void inverse_all(const Wrist *w, Py_ssize_t n, const double *Ts, const double *reference, double *joints,
                             double *gaps, unsigned char *free_)
{
    for (Py_ssize_t i = 0; i < n; i++)
        inverse_one(w, Ts + 16 * i, reference ? reference + 6 * i : NULL, joints + 48 * i, gaps + 8 * i, free_ + 48 * i);
}

typedef struct { /* what closed forms of six joints with eight solutions are given, and write */
    const double *arm, *Ts, *reference;
    double *joints, *gap;
    unsigned char *free_;
    Py_ssize_t n;
} Eight;

static int read_eight(Views *held, PyObject *const *args, Py_ssize_t given, size_t wide, Eight *of)
{
    Py_ssize_t size, poses, liked = 0, out, gaps, flags;
    of->reference = NULL;
    if (given != 6 || !(of->arm = numbers(held, args[0], 0, 8, &size)) || !(of->Ts = numbers(held, args[1], 0, 8, &poses))
        || (args[2] != Py_None && !(of->reference = numbers(held, args[2], 0, 8, &liked)))
        || !(of->joints = numbers(held, args[3], 1, 8, &out)) || !(of->gap = numbers(held, args[4], 1, 8, &gaps))
        || !(of->free_ = numbers(held, args[5], 1, 1, &flags)))
        return 0;
    Py_ssize_t n = of->n = poses / 16;
    return size * sizeof(double) == wide && poses == 16 * n && out == 48 * n && gaps == 8 * n && flags == 48 * n
           && (!of->reference || liked == 6 * n);
}

/* inverse(wrist, Ts, reference or None, joints, gap, free): SphericalWrist._solved on an Elbow; (n, 8, .) are written. */
static PyObject *inverse(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Eight of;
    if (!read_eight(&held, args, given, sizeof(Wrist), &of)) return wrong(&held);
    PyThreadState *state = of.n > RELEASE ? PyEval_SaveThread() : NULL;
    inverse_all((const Wrist *)of.arm, of.n, of.Ts, of.reference, of.joints, of.gap, of.free_);
    if (state) PyEval_RestoreThread(state);
    let_go(&held);
    Py_RETURN_NONE;
}

/* ------------------------------------------------------------------------------------------------ three joints */

#define POLISH 8          /* three_joints._POLISH and those that follow there */
#define REACHED_M 1e-11
#define ON_AXIS 1e-14
#define OFF_CIRCLE 5e-7   /* of a cosine: _OFF_CIRCLE of its angle */
#define SETTLED 5e-14     /* of the arm's size: no step leads nearer */
#define TILTED 1e-9       /* protocol.EXACT */

typedef struct { /* in the order of ThreeJoints' numbers */
    double slides[3], sign[3], axis[3][3], origin[3][3], point[3], start[3], turned[3][3], scale, roots, many;
    double plane_1[3][3], plane_2[3][3], eliminates[2][2], regular, towards, level[3], slide[3];
    double nodes[5][3], powers[5][5];
} Three;

INLINE double dot3(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

INLINE void cross3(const double *a, const double *b, double *out)
{
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

INLINE void less3(const double *a, const double *b, double *out)
{
    for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

INLINE void turn3(const double *axis, double c, double s, double *v) /* a vector about an axis */
{
    double ahead[3], along = dot3(axis, v) * (1 - c);
    cross3(axis, v, ahead);
    for (int i = 0; i < 3; i++) v[i] = along * axis[i] + c * v[i] + s * ahead[i];
}

INLINE void carry(const Three *a, int joint, double amount, double c, double s, double *p) /* Axes.carried */
{
    if (a->slides[joint]) {
        for (int i = 0; i < 3; i++) p[i] += amount * a->axis[joint][i];
        return;
    }
    double lever[3];
    less3(p, a->origin[joint], lever);
    turn3(a->axis[joint], c, s, lever);
    for (int i = 0; i < 3; i++) p[i] = a->origin[joint][i] + lever[i];
}

/* ThreeJoints._second: what is left of the equations for joint 3; joint 2's positions where q is not NULL. */
INLINE double second_joint(const Three *a, const double *at, const double *wanted, double *q)
{
    double lever[3], there[3], apart[3];
    const double *first = a->axis[0];
    if (a->slides[1]) {
        if (a->slides[0]) {
            less3(wanted, at, there);
            if (q) q[0] = dot3(a->slide, there);
            return dot3(a->level, there);
        }
        less3(at, a->origin[0], lever);
        less3(wanted, a->origin[0], there);
        double cosine = dot3(first, a->axis[1]), height = dot3(first, there) - dot3(first, lever), square = dot3(there, there);
        if (fabs(cosine) > TILTED) {
            double moved = height / cosine;
            for (int i = 0; i < 3; i++) lever[i] += moved * a->axis[1][i];
            if (q) q[0] = moved;
            return dot3(lever, lever) - square;
        }
        if (q) {
            double half = dot3(a->axis[1], lever), rest = half * half - dot3(lever, lever) + square;
            double root = rest > 0 ? sqrt(rest) : 0.0;
            q[0] = -half + root;
            q[1] = -half - root;
        }
        return height;
    }
    const double *w = a->plane_2[2];
    less3(at, a->origin[1], lever);
    double u = dot3(a->plane_2[0], lever), v = dot3(a->plane_2[1], lever), h = dot3(w, lever), right[2], e, f;
    if (a->slides[0]) {
        less3(wanted, a->origin[1], there);
        for (int i = 0; i < 2; i++)
            right[i] = a->scale * (dot3(a->plane_1[i], there) - dot3(a->plane_1[i], w) * h);
    } else {
        less3(a->origin[1], a->origin[0], apart);
        less3(wanted, a->origin[0], there);
        right[0] = a->scale * (dot3(first, there) - dot3(first, apart) - dot3(first, w) * h);
        right[1] = (dot3(there, there) - (u * u + v * v + h * h) - dot3(apart, apart)) / 2 - dot3(apart, w) * h;
    }
    e = a->eliminates[0][0] * right[0] + a->eliminates[0][1] * right[1];
    f = a->eliminates[1][0] * right[0] + a->eliminates[1][1] * right[1];
    if (a->regular) {
        if (q) q[0] = atan2(f * u - e * v, e * u + f * v);
        return e * e + f * f - u * u - v * v;
    }
    if (q) {
        double rest = u * u + v * v - e * e, opening = atan2(rest > 0 ? sqrt(rest) : 0.0, e), from = atan2(v, u);
        q[0] = a->towards + opening - from;
        q[1] = a->towards - opening - from;
    }
    return f;
}

INLINE double first_joint(const Three *a, const double *at, const double *wanted) /* ThreeJoints._first */
{
    double lever[3], there[3];
    if (a->slides[0]) {
        less3(wanted, at, there);
        return dot3(a->axis[0], there);
    }
    less3(at, a->origin[0], lever);
    less3(wanted, a->origin[0], there);
    double x = dot3(a->plane_1[0], lever), y = dot3(a->plane_1[1], lever);
    double z = dot3(a->plane_1[0], there), w = dot3(a->plane_1[1], there);
    return atan2(x * w - y * z, x * z + y * w);
}

/* The real roots of x^3 + a x^2 + b x + c: how many. */
static int cubic(double a, double b, double c, double root[3])
{
    double q = (a * a - 3 * b) / 9, r = (a * (2 * a * a - 9 * b) + 27 * c) / 54, below = q * q * q - r * r;
    int count = 1;
    if (below > 0) {
        double third = acos(fmax(-1.0, fmin(1.0, r / sqrt(q * q * q)))) / 3, size = -2 * sqrt(q);
        for (count = 0; count < 3; count++) root[count] = size * cos(third + count * (2 * M_PI / 3)) - a / 3;
    } else {
        double large = -copysign(cbrt(fabs(r) + sqrt(-below)), r);
        root[0] = (large != 0 ? large + q / large : 0.0) - a / 3;
    }
    for (int i = 0; i < count; i++)
        for (int twice = 0; twice < 2; twice++) {
            double x = root[i], slope = (3 * x + 2 * a) * x + b, step = (((x + a) * x + b) * x + c) / slope;
            if (fabs(step) < 1e-3 * (1 + fabs(x))) root[i] = x - step;
        }
    return count;
}

static void adjugate(double m[3][3], double out[3][3]) /* of a symmetric matrix */
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int k = (i + 1) % 3, l = (i + 2) % 3, p = (j + 1) % 3, q = (j + 2) % 3;
            out[i][j] = m[k][p] * m[l][q] - m[k][q] * m[l][p];
        }
}

/* Two lines that meet a conic x' P x = 0 where another, x' F x = 0, does: the pair of lines of their pencil F + l P.
 *
 * Four points in common are on three pairs of lines, of which one at least is real. It is split into its lines by the
 * adjugate, whose columns are along the point where they cross (Richter-Gebert 2011, Perspectives on Projective
 * Geometry, section 11.1). P is the unit circle or, for an equation in powers, the parabola y = x^2. */
static void common_lines(double F[3][3], int circle, double line[2][3])
{
    static const double P[2][3][3] = {{{1, 0, 0}, {0, 0, -0.5}, {0, -0.5, 0}}, {{1, 0, 0}, {0, 1, 0}, {0, 0, -1}}};
    static const double A[2][3][3] = {{{-0.25, 0, 0}, {0, 0, 0.5}, {0, 0.5, 0}}, {{-1, 0, 0}, {0, -1, 0}, {0, 0, 1}}};
    double largest = 0, across[3][3], M[3][3], best[3][3], apart = -INFINITY, linear = 0, square = 0, root[3];
    double last = circle ? -1.0 : -0.25;
    for (int i = 0; i < 9; i++) largest = fmax(largest, fabs(F[i / 3][i % 3]));
    for (int i = 0; i < 9; i++) F[i / 3][i % 3] /= largest > 1e-290 ? largest : 1e-290;
    adjugate(F, across);
    for (int i = 0; i < 9; i++) {
        linear += across[i / 3][i % 3] * P[circle][i / 3][i % 3];
        square += F[i / 3][i % 3] * A[circle][i / 3][i % 3];
    }
    int count = cubic(square / last, linear / last, dot3(F[0], across[0]) / last, root);
    for (int r = 0; r < count; r++) {
        double size = 0;
        for (int i = 0; i < 9; i++) {
            M[i / 3][i % 3] = F[i / 3][i % 3] + root[r] * P[circle][i / 3][i % 3];
            size += M[i / 3][i % 3] * M[i / 3][i % 3];
        }
        adjugate(M, across);
        double here = -(across[0][0] + across[1][1] + across[2][2]) / (size > 0 ? size : 1.0);
        if (!(here > apart) && r) continue;
        apart = here;
        memcpy(best, M, sizeof M);
    }
    adjugate(best, across);
    int k = 0, row = 0, column = 0;
    for (int i = 1; i < 3; i++)
        if (-across[i][i] > -across[k][k]) k = i;
    double length = -across[k][k] > 0 ? sqrt(-across[k][k]) : 0.0;
    for (int i = 0; i < 3 && length > 0; i++) {
        double part = -across[i][k] / length; /* of the crossing point: added as its cross product's matrix */
        best[(i + 1) % 3][(i + 2) % 3] += part;
        best[(i + 2) % 3][(i + 1) % 3] -= part;
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (fabs(best[i][j]) > fabs(best[row][column])) row = i, column = j;
    for (int i = 0; i < 3; i++) {
        line[0][i] = best[row][i];
        line[1][i] = best[i][column];
    }
}

/* Where l0 x + l1 y + l2 = 0 meets the circle: two angles; whether they are real, or nearly. */
static int on_circle(const double *line, double *root)
{
    double size = sqrt(line[0] * line[0] + line[1] * line[1]);
    if (!(size > 1e-14 * fabs(line[2]))) {
        root[0] = root[1] = 0.0;
        return 0;
    }
    double from = atan2(line[1], line[0]), height = -line[2] / size;
    double half = atan2(sqrt(fmax((1 - height) * (1 + height), 0.0)), height);
    root[0] = from + half;
    root[1] = from - half;
    return fabs(height) <= 1 + OFF_CIRCLE;
}

/* Where l0 x + l1 x^2 + l2 = 0: two x; whether they are real, or nearly; a bit each. */
static int on_parabola(const double *line, double *root)
{
    double below = line[0] * line[0] - 4 * line[1] * line[2], square = line[0] * line[0] + 4 * fabs(line[1] * line[2]);
    double sum = -(line[0] + copysign(sqrt(fmax(below, 0.0)), line[0])) / 2;
    int real = below >= -OFF_CIRCLE * square;
    root[0] = line[1] != 0 ? sum / line[1] : INFINITY;
    root[1] = sum != 0 ? line[2] / sum : line[1] != 0 ? 0.0 : INFINITY;
    for (int i = 0; i < 2; i++)
        if (!(fabs(root[i]) < 1e6)) root[i] = 1e6; /* at infinity */
    return real ? (root[0] < 1e6) | (root[1] < 1e6) << 1 : 0;
}

/* ThreeJoints._roots: joint 3's positions, and in the bits of what is returned which are real. */
static int third_joint(const Three *a, const double *wanted, double *root)
{
    double left[5], of[5], line[2][3];
    for (int i = 0; i < 5; i++) left[i] = second_joint(a, a->nodes[i], wanted, NULL);
    for (int i = 0; i < 5; i++) {
        of[i] = 0.0;
        for (int j = 0; j < 5; j++) of[i] += a->powers[i][j] * left[j];
    }
    if (a->slides[2]) { /* of powers */
        int real;
        if (a->roots < 3) {
            line[0][0] = of[1];
            line[0][1] = a->roots > 1 ? of[2] : 0.0;
            line[0][2] = of[0];
            real = on_parabola(line[0], root);
            if (a->roots < 2) {
                root[0] = root[1];
                real >>= 1;
            }
        } else {
            double F[3][3] = {{0, of[3] / 2, of[1] / 2}, {of[3] / 2, of[4], of[2] / 2}, {of[1] / 2, of[2] / 2, of[0]}};
            common_lines(F, 0, line);
            real = on_parabola(line[0], root);
            real |= on_parabola(line[1], root + 2) << 2;
            if (a->roots < 4) { /* the one farthest off is at infinity */
                int far = 0;
                for (int i = 1; i < 4; i++)
                    if (fabs(root[i]) > fabs(root[far])) far = i;
                root[far] = root[3];
                real = (real & ~(1 << far) & 7) | (far < 3 ? (real >> 3 & 1) << far : 0);
            }
        }
        for (int i = 0; i < (int)a->roots; i++) root[i] *= a->scale;
        return real;
    }
    if (a->roots < 3) { /* of cosine and sine */
        line[0][0] = 2 * of[1];
        line[0][1] = -2 * of[2];
        line[0][2] = of[0];
        return on_circle(line[0], root) ? 3 : 0;
    }
    double F[3][3] = {{2 * of[3], -2 * of[4], of[1]}, {-2 * of[4], -2 * of[3], -of[2]}, {of[1], -of[2], of[0]}};
    common_lines(F, 1, line);
    int real = on_circle(line[0], root) ? 3 : 0;
    return real | (on_circle(line[1], root + 2) ? 12 : 0);
}

/* Where the point is ("ThreeJoints._place"), its Jacobian ("_jacobian") by columns, and cosines and sines. */
INLINE void placed(const Three *a, const double *q, double *p, double J[3][3], double c[3], double s[3])
{
    for (int j = 0; j < 3; j++) {
        c[j] = a->slides[j] ? 1.0 : cos(q[j]);
        s[j] = a->slides[j] ? 0.0 : sin(q[j]);
    }
    memcpy(p, a->start, 3 * sizeof(double));
    for (int j = 2; j >= 0; j--) {
        double lever[3];
        carry(a, j, q[j], c[j], s[j], p);
        for (int k = j + 1; k < 3 && !a->slides[j]; k++) turn3(a->axis[j], c[j], s[j], J[k]);
        less3(p, a->origin[j], lever);
        if (a->slides[j])
            memcpy(J[j], a->axis[j], 3 * sizeof(double));
        else
            cross3(a->axis[j], lever, J[j]);
    }
}

/* ThreeJoints._settled of one candidate, in place; what it misses still, squared. */
static double settled_three(const Three *a, const double *wanted, double *q, double c[3], double s[3])
{
    double J[3][3], p[3], missing[3], moved[3], ahead[3][3], left[3], cosine[3], sine[3], damping = 0.0;
    placed(a, q, p, J, c, s);
    less3(wanted, p, missing);
    double size = dot3(missing, missing), enough = SETTLED * a->scale * SETTLED * a->scale;
    for (int step = 0; step < POLISH && size > enough; step++) {
        double m[3][3], right[3], out[3][3], trace = 0;
        for (int i = 0; i < 3; i++) {
            double unit = a->slides[i] ? a->scale : 1.0;
            for (int j = 0; j <= i; j++)
                m[i][j] = m[j][i] = unit * (a->slides[j] ? a->scale : 1.0) * dot3(J[i], J[j]);
            right[i] = unit * dot3(J[i], missing);
            trace += m[i][i];
        }
        for (int i = 0; i < 3; i++) m[i][i] += (1e-14 + damping) * trace;
        adjugate(m, out);
        double whole = dot3(m[0], out[0]);
        for (int i = 0; i < 3; i++)
            moved[i] = q[i] + (a->slides[i] ? a->scale : 1.0) * (whole != 0 ? dot3(out[i], right) / whole : 0.0);
        placed(a, moved, p, ahead, cosine, sine);
        less3(wanted, p, left);
        double here = dot3(left, left);
        int better = here < size;
        if (better) {
            memcpy(q, moved, sizeof moved);
            memcpy(J, ahead, sizeof ahead);
            memcpy(missing, left, sizeof left);
            memcpy(c, cosine, sizeof cosine);
            memcpy(s, sine, sizeof sine);
            size = here;
        }
        damping = better ? damping / 10 : fmax(10 * damping, 1e-6);
    }
    return size;
}

/* ThreeJoints._freed: hinges 1 and 2 as they are liked where the point is on their axes. */
INLINE int freed_three(const Three *a, const double *wanted, const double *liked, double c, double s, double *q,
                       unsigned char *free_)
{
    double third[3];
    memcpy(third, a->start, sizeof third);
    carry(a, 2, q[2], c, s, third);
    for (int joint = 0; joint < 2; joint++) {
        double lever[3], across[3];
        less3(joint ? third : wanted, a->origin[joint], lever);
        cross3(a->axis[joint], lever, across);
        free_[joint] = !a->slides[joint] && dot3(across, across) <= ON_AXIS * a->scale * ON_AXIS * a->scale;
        if (free_[joint]) q[joint] = liked ? liked[joint] * a->sign[joint] : 0.0;
    }
    free_[2] = 0;
    return free_[0] | free_[1];
}

/* The angle between the last link's rotation and one that is wanted. */
static double tilt_three(const Three *a, const double *T, const double c[3], const double s[3])
{
    double chord = 0, both = 0;
    for (int k = 0; k < 3; k++) {
        double v[3] = {a->turned[0][k], a->turned[1][k], a->turned[2][k]};
        for (int j = 2; j >= 0; j--)
            if (!a->slides[j]) turn3(a->axis[j], c[j], s[j], v);
        for (int i = 0; i < 3; i++) {
            chord += (T[4 * i + k] - v[i]) * (T[4 * i + k] - v[i]);
            both += T[4 * i + k] * v[i];
        }
    }
    double tilt = 2 * atan2(sqrt(chord / 2), sqrt(fmax(1 + both, 0.0))); /* sin and cos of half of it, times 2 */
    return tilt <= TILTED ? 0.0 : tilt;
}

static void three_one(const Three *a, const double *T, const double *liked, double *joints, double *gaps, double *tilts,
                      unsigned char *free_)
{
    double wanted[3], root[4] = {0, 0, 0, 0};
    for (int i = 0; i < 3; i++) wanted[i] = T[4 * i] * a->point[0] + T[4 * i + 1] * a->point[1] + T[4 * i + 2] * a->point[2] + T[4 * i + 3];
    int real = third_joint(a, wanted, root), roots = (int)a->roots, many = (int)a->many;
    for (int r = 0; r < roots; r++) {
        double second[2], at[3], c3 = a->slides[2] ? 1.0 : cos(root[r]), s3 = a->slides[2] ? 0.0 : sin(root[r]);
        memcpy(at, a->start, sizeof at);
        carry(a, 2, root[r], c3, s3, at);
        second_joint(a, at, wanted, second);
        for (int k = 0; k < many; k++) {
            int branch = k * roots + r;
            double *q = joints + 3 * branch, c[3], s[3], p[3], J[3][3], two[3], size = INFINITY;
            memcpy(two, at, sizeof two);
            q[1] = second[k];
            q[2] = root[r];
            carry(a, 1, q[1], a->slides[1] ? 1.0 : cos(q[1]), a->slides[1] ? 0.0 : sin(q[1]), two);
            q[0] = first_joint(a, two, wanted);
            if (real >> r & 1) {
                size = settled_three(a, wanted, q, c, s);
                c3 = c[2];
                s3 = s[2];
            }
            if (freed_three(a, wanted, liked, c3, s3, q, free_ + 3 * branch) || (tilts && !(real >> r & 1))) {
                placed(a, q, p, J, c, s);
                less3(wanted, p, p);
                size = dot3(p, p);
            }
            int found = (real >> r & 1) && sqrt(size) <= REACHED_M;
            gaps[branch] = found ? 0.0 : size < INFINITY ? fmax(sqrt(size), a->scale) : a->scale;
            if (tilts) tilts[branch] = tilt_three(a, T, c, s);
            for (int i = 0; i < 3; i++) q[i] = a->sign[i] * (a->slides[i] ? q[i] : wrapped(q[i]));
        }
    }
}

/* three_joints(numbers, Ts, reference or None, joints, gap, tilt or None, free): ThreeJoints._solved, but for the nearest
 * joints of places out of reach; (n, k, .) are written. */
static PyObject *three_joints(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Py_ssize_t size, poses, liked = 0, out, gaps, tilted = 0, flags;
    const double *numbers_, *Ts, *reference = NULL;
    double *joints, *gap, *tilt = NULL;
    unsigned char *free_;
    if (given != 7 || !(numbers_ = numbers(&held, args[0], 0, 8, &size)) || !(Ts = numbers(&held, args[1], 0, 8, &poses))
        || (args[2] != Py_None && !(reference = numbers(&held, args[2], 0, 8, &liked)))
        || !(joints = numbers(&held, args[3], 1, 8, &out)) || !(gap = numbers(&held, args[4], 1, 8, &gaps))
        || (args[5] != Py_None && !(tilt = numbers(&held, args[5], 1, 8, &tilted)))
        || !(free_ = numbers(&held, args[6], 1, 1, &flags)))
        return wrong(&held);
    const Three *arm = (const Three *)numbers_;
    if (size * sizeof(double) != sizeof(Three) || arm->roots < 1 || arm->roots > 4 || arm->many < 1 || arm->many > 2)
        return wrong(&held);
    Py_ssize_t n = poses / 16, k = (Py_ssize_t)(arm->roots * arm->many);
    if (poses != 16 * n || out != 3 * k * n || gaps != k * n || flags != 3 * k * n || (tilt && tilted != k * n)
        || (reference && liked != 3 * n))
        return wrong(&held);
    PyThreadState *state = n > RELEASE ? PyEval_SaveThread() : NULL;
    for (Py_ssize_t i = 0; i < n; i++)
        three_one(arm, Ts + 16 * i, reference ? reference + 3 * i : NULL, joints + 3 * k * i, gap + k * i,
                  tilt ? tilt + k * i : NULL, free_ + 3 * k * i);
    if (state) PyEval_RestoreThread(state);
    let_go(&held);
    Py_RETURN_NONE;
}

/* ------------------------------------------------------------------------------------------------ three parallel axes */

typedef struct { /* in the order of ThreeParallel's numbers */
    double sign[6], centre[3], root[3], parts[27], back[9], turning[2], shoulder[2], hand[2];
    double upper, upper_bent, fore, fore_bent, offset, bend;
} Parallel;

/* The turn phi about w, and joints 5 and 6, one way of joint 5: ThreeParallel._turns. */
INLINE void turns(const Parallel *a, double M[3][3], const double *hand, double size, double way, double cb, double sb,
                  double phi[3], double *fifth, double *sixth)
{
    double whole = sqrt(size * size + hand[2] * hand[2]), cosine = hand[2] / whole, sine = way * size / whole;
    double along[2] = {cosine * cb + sine * sb, sine * cb - cosine * sb}; /* of joint 5 */
    double y = way * M[2][1], x = -way * (M[2][0] * cb - M[2][2] * sb), far = sqrt(x * x + y * y);
    double axis_6[3] = {sb, 0, cb}, level[3] = {along[0], 0, along[1]};
    *fifth = atan2(sine, cosine) - a->bend;
    *sixth = atan2(y, x);
    turn3(axis_6, far > 0 ? x / far : 1.0, far > 0 ? -y / far : 0.0, level);
    double left[2] = {dot3(M[0], level), dot3(M[1], level)}, length = sqrt(left[0] * left[0] + left[1] * left[1]);
    phi[0] = atan2(left[1], left[0]);
    phi[1] = length > 0 ? left[0] / length : 1.0;
    phi[2] = length > 0 ? left[1] / length : 0.0;
}

INLINE void parallel_one(const Parallel *a, const double *T, const double *liked, double *joints, double *gaps,
                         unsigned char *free_)
{
    double R[9], position[3], split[9], column[3], splits[3][9], first[2], gap_1, gap_8, root[2], elbow[2];
    double cb = cos(a->bend), sb = sin(a->bend);
    double liked_1 = liked ? liked[0] * a->sign[0] : 0.0, liked_2 = liked ? liked[1] * a->sign[1] : 0.0;
    unsigned char free_1, free_2;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[3 * i + j] = T[4 * i + j];
    times(R, 3, a->centre, position);
    for (int i = 0; i < 3; i++) position[i] += T[4 * i + 3] - a->root[i];
    times(a->parts, 9, position, split);
    for (int k = 0; k < 3; k++) { /* axes e, f and w of the last frame */
        times(R, 3, a->back + 3 * k, column);
        times(a->parts, 9, column, splits[k]);
    }
    type_2(-split[8], split[5], a->offset - split[2], liked_1, first, &gap_1, &free_1);
    for (int i = 0; i < 2; i++) {
        double c = cos(first[i]), s = sin(first[i]), M[3][3], hand[3];
        double e = split[0] + c * split[3] - s * split[6], f = split[1] + c * split[4] - s * split[7];
        for (int row = 0; row < 3; row++) {
            for (int k = 0; k < 3; k++) M[row][k] = splits[k][row] + c * splits[k][3 + row] - s * splits[k][6 + row];
            hand[row] = M[row][0] * sb + M[row][2] * cb;
        }
        double size = sqrt(hand[0] * hand[0] + hand[1] * hand[1]);
        for (int j = 0; j < 2; j++) {
            double phi[3], fifth, sixth;
            turns(a, M, hand, size, j ? -1.0 : 1.0, cb, sb, phi, &fifth, &sixth);
            double x = e - a->shoulder[0] - (a->hand[0] * phi[1] - a->hand[1] * phi[2]);
            double y = f - a->shoulder[1] - (a->hand[0] * phi[2] + a->hand[1] * phi[1]);
            type_8(a->upper, a->fore, x, y, liked_2 + a->upper_bent, root, elbow, &gap_8, &free_2);
            for (int k = 0; k < 2; k++) {
                int branch = 4 * k + 2 * j + i;
                double second = root[k] - a->upper_bent, third = elbow[k] + a->upper_bent - a->fore_bent;
                double q[6] = {first[i], second, a->turning[0] * third, a->turning[1] * (phi[0] - second - third),
                               fifth, sixth};
                unsigned char flags[6] = {free_1, free_2, 0, 0, 0, size <= TINY};
                for (int m = 0; m < 6; m++) joints[6 * branch + m] = a->sign[m] * wrapped(q[m]);
                gaps[branch] = gap_1 > gap_8 ? gap_1 : gap_8;
                memcpy(free_ + 6 * branch, flags, 6);
            }
        }
    }
}

WIDE static void parallel_all(const Parallel *a, Py_ssize_t n, const double *Ts, const double *reference, double *joints,
                              double *gaps, unsigned char *free_)
{
    for (Py_ssize_t i = 0; i < n; i++)
        parallel_one(a, Ts + 16 * i, reference ? reference + 6 * i : NULL, joints + 48 * i, gaps + 8 * i, free_ + 48 * i);
}

/* three_parallel(numbers, Ts, reference or None, joints, gap, free): ThreeParallel._solved, but for poses where joint 6 is
 * free, whose flag alone counts; (n, 8, .) are written. */
static PyObject *three_parallel(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Eight of;
    if (!read_eight(&held, args, given, sizeof(Parallel), &of)) return wrong(&held);
    PyThreadState *state = of.n > RELEASE ? PyEval_SaveThread() : NULL;
    parallel_all((const Parallel *)of.arm, of.n, of.Ts, of.reference, of.joints, of.gap, of.free_);
    if (state) PyEval_RestoreThread(state);
    let_go(&held);
    Py_RETURN_NONE;
}

/* ------------------------------------------------------------------------------------------------ five axes */

#define FIVE 5
#define STEPS 4 /* numpy_kernels._STEPS and those that follow there */
#define NEAR 1e-2
#define EXACTLY 1e-13

typedef struct {
    double joints[FIVE], missing[6], jacobian[6][FIVE];
    Py_ssize_t row;
} Candidate;

typedef struct {
    const Arm *arm;
    const double *values, *Ts;
    double *joints, *off;
    Py_ssize_t many; /* candidates of a pose */
} Five;

/* What candidates miss where they are now, and their Jacobians: missed() of numpy_kernels.settle. */
static void missed_by(const Five *of, Walk *w, Candidate *each, int count)
{
    double joints[FIVE * BLOCK], columns[3 * BLOCK];
    int before = of->arm->parameters - 3 * of->arm->targets;
    for (int t = 0; t < count; t++) memcpy(joints + FIVE * t, each[t].joints, sizeof each[t].joints);
    walk(of->arm, of->values, joints, count, w);
    for (int m = 6; m < before; m++) {
        const Motion *motion = w->motions + m;
        if (motion->joint < 0) continue;
        double sign = of->arm->sign[motion->joint];
        column(motion, w->origin, sign, count, columns, BLOCK);
        for (int t = 0; t < count; t++)
            for (int i = 0; i < 3; i++) {
                each[t].jacobian[i][motion->joint] = columns[i * BLOCK + t];
                each[t].jacobian[3 + i][motion->joint] = motion->origin == NULL ? 0.0 : sign * motion->axis[i][t];
            }
    }
    for (int t = 0; t < count; t++) {
        const double *T = of->Ts + 16 * (each[t].row / of->many);
        double R[9] = {T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]};
        for (int i = 0; i < 3; i++) each[t].missing[i] = T[4 * i + 3] - w->origin[i][t];
        missing_rotation(R, w, t, each[t].missing + 3);
    }
}

static void lead(const Candidate *from, Candidate *to) /* a step of Gauss and Newton */
{
    double normal[FIVE * FIVE], right[FIVE], factor[FIVE * FIVE], step[FIVE], trace = 0;
    for (int j = 0; j < FIVE; j++) {
        right[j] = 0.0;
        for (int i = 0; i < 6; i++) right[j] += from->jacobian[i][j] * from->missing[i];
        for (int k = 0; k <= j; k++) {
            double sum = 0.0;
            for (int i = 0; i < 6; i++) sum += from->jacobian[i][j] * from->jacobian[i][k];
            normal[j * FIVE + k] = sum;
        }
        trace += normal[j * FIVE + j];
    }
    for (int j = 0; j < FIVE; j++) normal[j * FIVE + j] += 1e-15 * trace;
    int regular = solved(normal, right, FIVE, factor, step);
    for (int j = 0; j < FIVE; j++) to->joints[j] = from->joints[j] + (regular ? step[j] : 0.0);
    to->row = from->row;
}

static void lead_on(const Five *of, Walk *w, Candidate *each, Candidate *ahead, int count)
{
    missed_by(of, w, each, count);
    for (int step = 0; step < STEPS && count; step++) {
        int going = 0;
        for (int t = 0; t < count; t++) lead(each + t, ahead + t);
        missed_by(of, w, ahead, count);
        for (int t = 0; t < count; t++) {
            const double *e = ahead[t].missing;
            double largest = 0.0;
            if (!(size_of(e, 1.0) < size_of(each[t].missing, 1.0))) continue;
            memcpy(of->joints + FIVE * ahead[t].row, ahead[t].joints, sizeof ahead[t].joints);
            of->off[2 * ahead[t].row] = sqrt(dot3(e, e));
            of->off[2 * ahead[t].row + 1] = sqrt(dot3(e + 3, e + 3));
            for (int i = 0; i < 6; i++) largest = fmax(largest, fabs(e[i]));
            if (largest > EXACTLY) each[going++] = ahead[t];
        }
        count = going;
    }
}

static void settle_all(const Five *of, Py_ssize_t n, Walk *w, Candidate *each, Candidate *ahead)
{
    int waiting = 0;
    for (Py_ssize_t first = 0; first < n; first += BLOCK) {
        int count = n - first < BLOCK ? (int)(n - first) : BLOCK;
        walk(of->arm, of->values, of->joints + FIVE * first, count, w);
        double near[BLOCK], turned[BLOCK];
        for (int t = 0; t < count; t++) {
            const double *T = of->Ts + 16 * ((first + t) / of->many);
            near[t] = turned[t] = 0.0;
            for (int i = 0; i < 3; i++) {
                double d = T[4 * i + 3] - w->origin[i][t];
                near[t] += d * d;
                for (int j = 0; j < 3; j++) {
                    d = T[4 * i + j] - w->frame[j][i][t];
                    turned[t] += d * d;
                }
            }
        }
        Candidate added[BLOCK];
        int more = 0;
        for (int t = 0; t < count; t++) {
            Py_ssize_t row = first + t;
            double *off = of->off + 2 * row, half = sqrt(turned[t] / 8);
            off[0] = sqrt(near[t]);
            off[1] = 2 * asin(half < 1 ? half : 1.0);
            double larger = off[0] > off[1] ? off[0] : off[1];
            if (!(larger < NEAR && larger > EXACTLY)) continue;
            added[more].row = row;
            memcpy(added[more++].joints, of->joints + FIVE * row, sizeof added[0].joints);
        }
        for (int t = 0; t < more; t++) {
            each[waiting++] = added[t];
            if (waiting < BLOCK) continue;
            lead_on(of, w, each, ahead, waiting);
            waiting = 0;
        }
    }
    if (waiting) lead_on(of, w, each, ahead, waiting);
    for (Py_ssize_t row = 0; row < n; row++)
        for (int j = 0; j < FIVE; j++)
            if (!of->arm->slides[j]) of->joints[FIVE * row + j] = wrapped(of->joints[FIVE * row + j]);
}

/* settle(shape, sign, values, Ts, joints, off): numpy_kernels.settle; joints (n, k, 5) are changed, off (n, k, 2) written. */
static PyObject *settle(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Arm arm;
    Walk w;
    Five of = {.arm = &arm};
    Py_ssize_t p, poses, out, missing;
    if (given != 6 || !read_arm(&held, args[0], args[1], &arm) || !(of.values = numbers(&held, args[2], 0, 8, &p))
        || !(of.Ts = numbers(&held, args[3], 0, 8, &poses)) || !(of.joints = numbers(&held, args[4], 1, 8, &out))
        || !(of.off = numbers(&held, args[5], 1, 8, &missing)))
        return wrong(&held);
    Py_ssize_t n = poses / 16, rows = out / FIVE;
    if (arm.links != FIVE || p != arm.parameters || poses != 16 * n || (n ? rows % n : rows) || out != FIVE * rows
        || missing != 2 * rows)
        return wrong(&held);
    of.many = n ? rows / n : 1;
    Candidate *space = malloc(2 * BLOCK * sizeof(Candidate));
    if (space == NULL || !room(&arm, &w)) {
        free(space);
        let_go(&held);
        return PyErr_NoMemory();
    }
    PyThreadState *state = n > RELEASE ? PyEval_SaveThread() : NULL;
    settle_all(&of, rows, &w, space, space + BLOCK);
    if (state) PyEval_RestoreThread(state);
    free(w.axes);
    free(space);
    let_go(&held);
    Py_RETURN_NONE;
}

/* ------------------------------------------------------------------------------------------------ a planar arm between two joints */

typedef struct { /* in the order of FiveAxes' numbers */
    double slides, axis[2][3], origin[2][3], plane[3][3], back[3][3], centre[3], held_5[3], axis_5[3], start[3];
    double size, unused[3];
} Planar;

/* X, Y and Z of w . Rot(axis 1, -t) v = height as type 2. */
INLINE void facing(const Planar *a, const double *v, double height, double equation[3])
{
    const double *w = a->plane[2], *axis = a->axis[0];
    double ahead[3], along = dot3(w, axis) * dot3(axis, v);
    cross3(axis, v, ahead);
    equation[0] = -dot3(w, ahead);
    equation[1] = dot3(w, v) - along;
    equation[2] = height - along;
}

/* FiveAxes._frame_by_numpy of one pose: (5, m, n) from a pose's first number on. */
INLINE void middle_one(const Planar *a, const double *T, const double *liked, double *out, Py_ssize_t n, unsigned char *free_)
{
    double lever[3], fifth[3], N[3][3], first[2], gap, offset = 0;
    const double *w = a->plane[2];
    int roots = a->slides ? 1 : 2;
    for (int i = 0; i < 3; i++) {
        lever[i] = dot3(T + 4 * i, a->centre) + T[4 * i + 3] - a->origin[0][i];
        fifth[i] = dot3(T + 4 * i, a->held_5);
        for (int k = 0; k < 3; k++) N[k][i] = dot3(T + 4 * i, a->back[k]);
        offset += w[i] * (a->start[i] - a->origin[0][i]);
    }
    *free_ = 0;
    if (roots == 1)
        first[0] = (dot3(w, lever) - offset) / dot3(w, a->axis[0]);
    else {
        double by_place[3], by_turn[3], scaled[3] = {lever[0] / a->size, lever[1] / a->size, lever[2] / a->size};
        facing(a, scaled, offset / a->size, by_place);
        facing(a, fifth, a->axis_5[2], by_turn);
        const double *p = by_place, *t = by_turn;
        const double *e = t[0] * t[0] + t[1] * t[1] - t[2] * t[2] > p[0] * p[0] + p[1] * p[1] - p[2] * p[2] ? t : p;
        type_2(e[0], e[1], e[2], liked[0], first, &gap, free_);
    }
    for (int r = 0; r < roots; r++) {
        double at[3] = {lever[0], lever[1], lever[2]}, M[3][3], c = cos(first[r]), s = sin(first[r]);
        if (roots == 1)
            for (int i = 0; i < 3; i++) at[i] -= first[r] * a->axis[0][i];
        else
            turn3(a->axis[0], c, -s, at);
        for (int k = 0; k < 3; k++) {
            double v[3] = {N[k][0], N[k][1], N[k][2]};
            if (roots == 2) turn3(a->axis[0], c, -s, v);
            for (int i = 0; i < 3; i++) M[i][k] = dot3(a->plane[i], v);
        }
        const double *b = a->axis_5; /* axis 5 in the plane's axes: how it turns w */
        double level[3] = {-b[0] * b[2], -b[1] * b[2], 1 - b[2] * b[2]}, ahead[3] = {b[1], -b[0], 0};
        double y = -dot3(M[2], ahead), x = dot3(M[2], level), far = sqrt(x * x + y * y);
        double e0[3] = {1, 0, 0}, e1[3] = {0, 1, 0}, cosine = far > 0 ? x / far : 1.0, sine = far > 0 ? y / far : 0.0;
        turn3(b, cosine, -sine, e0);
        turn3(b, cosine, -sine, e1);
        double found[5] = {first[r], atan2(y, x), atan2(dot3(M[1], e0) - dot3(M[0], e1), dot3(M[0], e0) + dot3(M[1], e1)),
                           dot3(a->plane[0], at), dot3(a->plane[1], at)};
        for (int i = 0; i < 5; i++) out[(i * roots + r) * n] = found[i];
    }
}

/* planar_frame(numbers, Ts, liked, found, free): FiveAxes._frame_by_numpy. liked (n, 2); found (5, m, n)
 * and free (n,) are written. */
static PyObject *planar_frame(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    (void)self;
    Views held = {.count = 0};
    Py_ssize_t size, poses, wishes, out, flags;
    const double *numbers_, *Ts, *liked;
    double *found;
    unsigned char *free_;
    if (given != 5 || !(numbers_ = numbers(&held, args[0], 0, 8, &size)) || !(Ts = numbers(&held, args[1], 0, 8, &poses))
        || !(liked = numbers(&held, args[2], 0, 8, &wishes)) || !(found = numbers(&held, args[3], 1, 8, &out))
        || !(free_ = numbers(&held, args[4], 1, 1, &flags)))
        return wrong(&held);
    const Planar *a = (const Planar *)numbers_;
    if (size * sizeof(double) != sizeof(Planar)) return wrong(&held);
    int roots = a->slides ? 1 : 2;
    Py_ssize_t n = poses / 16;
    if (poses != 16 * n || wishes != 2 * n || out != 5 * roots * n || flags != n) return wrong(&held);
    for (Py_ssize_t i = 0; i < n; i++) middle_one(a, Ts + 16 * i, liked + 2 * i, found + i, n, free_ + i);
    let_go(&held);
    Py_RETURN_NONE;
}
