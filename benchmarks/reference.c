/* The plant once more in C: what the compiled one is measured against.
 *
 * The equations of rovtwin.vehicle.dynamics.plant_step in water that moves as one: thrusters with quantisation, dead
 * band, power law, exact lag and rate limit; Coriolis from the momentum, damping ahead and astern, restoring, current
 * with its rate, an external wrench; RK4, the quaternion normalised after each step.
 *
 * A `real` is a number, or with -DLANES=8 that of eight vehicles side by side, each with parameters of its own.
 * For one vehicle the columns of matrices are the vectors that the processor works on, padded from 6 to 8 rows.
 *
 * cc -O3 -march=native -fPIC -shared -DTHRUSTERS=6 reference.c -o reference.so -lm
 */
#include <math.h>

#ifndef LANES
#define LANES 1
#endif
#define N THRUSTERS

#if LANES == 1
#define ROWS 8
typedef double real;
typedef int mask;
static inline real pick(mask m, real a, real b) { return m ? a : b; }
#else
#define ROWS 6
typedef double real __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));
static inline real pick(mask m, real a, real b) { return (real)(((mask)a & m) | ((mask)b & ~m)); }
#endif

typedef struct {
    real M[6][ROWS], M_inv[6][ROWS], M_RB[3][ROWS], D[24][ROWS], T[N][ROWS]; /* columns; of M_RB the first three */
    real W, B, r_g[3], r_b[3], m_f;
    real ahead[N], astern[N], exponent[N], dead_band[N], time_constant[N], rate_limit[N], quantum[N], health[N];
} Plant;

typedef struct { real p[3], q[4], nu[6], thrust[N]; } State;
typedef struct { real p[3], q[4], nu[6]; } Rigid;
typedef struct { real velocity[3], rate[3], wrench[6]; } Water;

static inline real number(double x) { return (real){0} + x; }
static inline real larger(real a, real b) { return pick(a > b, a, b); }
static inline real smaller(real a, real b) { return pick(a < b, a, b); }

/* What the C library does number by number. */
#define EACH(name, call)                                    \
    static inline real name(real x, real y) {               \
        const double *a = (double *)&x, *b = (double *)&y;  \
        real out;                                           \
        double *o = (double *)&out;                         \
        for (int i = 0; i < LANES; i++) o[i] = call;        \
        return (void)b, out;                                \
    }
EACH(power, pow(a[i], b[i]))
EACH(rounded, rint(a[i] / b[i]) * b[i])
EACH(root, sqrt(a[i]))
EACH(decay_over, exp(-a[i] / b[i]))

static inline void cross(const real a[3], const real b[3], real out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* A x; three sums, for none to wait for the one before. The number of columns is a multiple of three. */
static inline void product(const real (*A)[ROWS], const real *x, int columns, real out[ROWS]) {
#if LANES == 1
    typedef double column __attribute__((vector_size(8 * ROWS), may_alias));
    const column *a = (const column *)A;
    column sum[3] = {a[0] * x[0], a[1] * x[1], a[2] * x[2]};
    for (int j = 3; j < columns; j += 3)
        for (int i = 0; i < 3; i++) sum[i] += a[j + i] * x[j + i];
    sum[0] += sum[1] + sum[2];
    for (int i = 0; i < ROWS; i++) out[i] = sum[0][i];
#else
    for (int i = 0; i < ROWS; i++) {
        out[i] = A[0][i] * x[0];
        for (int j = 1; j < columns; j++) out[i] += A[j][i] * x[j];
    }
#endif
}

static inline void rotation(const real q[4], real R[3][3]) {
    const real w = q[0], x = q[1], y = q[2], z = q[3];
    R[0][0] = 1 - 2 * (y * y + z * z), R[0][1] = 2 * (x * y - w * z), R[0][2] = 2 * (x * z + w * y);
    R[1][0] = 2 * (x * y + w * z), R[1][1] = 1 - 2 * (x * x + z * z), R[1][2] = 2 * (y * z - w * x);
    R[2][0] = 2 * (x * z - w * y), R[2][1] = 2 * (y * z + w * x), R[2][2] = 1 - 2 * (x * x + y * y);
}

static inline void to_body(real R[3][3], const real v[3], real out[3]) {
    for (int i = 0; i < 3; i++) out[i] = R[0][i] * v[0] + R[1][i] * v[1] + R[2][i] * v[2];
}

static inline real static_force(const Plant *m, int k, real u) {
    mask stepped = m->quantum[k] > 0;
    u = pick(stepped, rounded(u, pick(stepped, m->quantum[k], number(1))), u);
    u = larger(smaller(u, number(1)), number(-1));
    real x = (pick(u < 0, -u, u) - m->dead_band[k]) / (1 - m->dead_band[k]);
    mask moving = x > 0;
    real shape = pick(moving, power(pick(moving, x, number(1)), m->exponent[k]), number(0));
    return m->health[k] * pick(u >= 0, m->ahead[k], -m->astern[k]) * shape;
}

static inline real lag(const Plant *m, int k, real decay, real force, real target, double dt) {
    real room = m->rate_limit[k] * dt;
    return force + larger(smaller((1 - decay) * (target - force), room), -room);
}

/* x_dot, `elapsed` seconds into the step */
static inline void derivative(const Plant *m, const Rigid *x, const real tau[6], const Water *water, double elapsed,
                              Rigid *out) {
    real R[3][3], v_n[3], v_c[3], a[3], nu_r[6], split[24], s[3], c[3];
    real drag[ROWS], inertia[ROWS], momentum[ROWS], force[6], nu_dot[ROWS];
    const real *nu = x->nu, *omega = x->nu + 3, *q = x->q;
    rotation(q, R);
    for (int i = 0; i < 3; i++) v_n[i] = water->velocity[i] + elapsed * water->rate[i];
    to_body(R, v_n, v_c);
    to_body(R, water->rate, a);
    for (int i = 0; i < 3; i++) nu_r[i] = nu[i] - v_c[i], nu_r[i + 3] = omega[i];
    for (int i = 0; i < 6; i++) {
        real ahead = larger(nu_r[i], number(0)), astern = larger(-nu_r[i], number(0));
        split[i] = ahead, split[i + 6] = astern, split[i + 12] = ahead * ahead, split[i + 18] = astern * astern;
    }
    product(m->D, split, 24, drag);
    product(m->M_RB, a, 3, inertia);
    for (int i = 0; i < 6; i++) force[i] = tau[i] + water->wrench[i] - inertia[i] - drag[i];

    product(m->M, nu_r, 6, momentum); /* C(nu_r) nu_r */
    cross(omega, momentum, s);
    for (int i = 0; i < 3; i++) force[i] -= s[i];
    cross(nu_r, momentum, s);
    cross(omega, momentum + 3, c);
    for (int i = 0; i < 3; i++) force[i + 3] -= s[i] + c[i];

    real weight[3], pressure[3]; /* of the water: buoyancy, and what its acceleration does */
    for (int i = 0; i < 3; i++) {
        weight[i] = m->W * R[2][i];
        pressure[i] = m->m_f * a[i] - m->B * R[2][i];
        force[i] += weight[i] + pressure[i];
    }
    cross(m->r_g, weight, s);
    cross(m->r_b, pressure, c);
    for (int i = 0; i < 3; i++) force[i + 3] += s[i] + c[i];

    product(m->M_inv, force, 6, nu_dot);
    cross(omega, v_c, c);
    for (int i = 0; i < 3; i++) out->nu[i] = nu_dot[i] + a[i] - c[i], out->nu[i + 3] = nu_dot[i + 3];
    for (int i = 0; i < 3; i++) out->p[i] = R[i][0] * nu[0] + R[i][1] * nu[1] + R[i][2] * nu[2];
    out->q[0] = 0.5 * (-q[1] * omega[0] - q[2] * omega[1] - q[3] * omega[2]);
    out->q[1] = 0.5 * (q[0] * omega[0] + q[2] * omega[2] - q[3] * omega[1]);
    out->q[2] = 0.5 * (q[0] * omega[1] - q[1] * omega[2] + q[3] * omega[0]);
    out->q[3] = 0.5 * (q[0] * omega[2] + q[1] * omega[1] - q[2] * omega[0]);
}

#define PARTS (sizeof(Rigid) / sizeof(real))

static inline Rigid along(const Rigid *x, const Rigid *rate, double h) {
    Rigid out;
    for (unsigned i = 0; i < PARTS; i++) ((real *)&out)[i] = ((real *)x)[i] + h * ((real *)rate)[i];
    return out;
}

static inline void plant_step(const Plant *m, const real *decay, State *state, const real *u, const Water *water,
                              double dt) {
    real before[N], halfway[N], after[N], tau[3][ROWS];
    for (int k = 0; k < N; k++) {
        real target = static_force(m, k, u[k]);
        mask jumps = (m->time_constant[k] <= 0) & (m->rate_limit[k] > 1e300);
        before[k] = pick(jumps, target, state->thrust[k]);
        halfway[k] = lag(m, k, decay[k], before[k], target, 0.5 * dt);
        state->thrust[k] = after[k] = lag(m, k, decay[k], halfway[k], target, 0.5 * dt);
    }
    const real *forces[3] = {before, halfway, after};
    for (int when = 0; when < 3; when++)
        for (int i = 0; i < ROWS; i++) {
            tau[when][i] = number(0);
            for (int k = 0; k < N; k++) tau[when][i] += m->T[k][i] * forces[when][k];
        }
    Rigid *x = (Rigid *)state, at, k1, k2, k3, k4; /* a State begins with a Rigid */
    derivative(m, x, tau[0], water, 0, &k1);
    at = along(x, &k1, 0.5 * dt);
    derivative(m, &at, tau[1], water, 0.5 * dt, &k2);
    at = along(x, &k2, 0.5 * dt);
    derivative(m, &at, tau[1], water, 0.5 * dt, &k3);
    at = along(x, &k3, dt);
    derivative(m, &at, tau[2], water, dt, &k4);
    for (unsigned i = 0; i < PARTS; i++) {
        real middle = ((real *)&k2)[i] + ((real *)&k3)[i];
        ((real *)x)[i] += dt / 6 * (((real *)&k1)[i] + 2 * middle + ((real *)&k4)[i]);
    }
    real square = x->q[0] * x->q[0] + x->q[1] * x->q[1] + x->q[2] * x->q[2] + x->q[3] * x->q[3];
    real length = root(square, square);
    for (int i = 0; i < 4; i++) x->q[i] /= length;
}

/* Moves the state on by `steps` steps, in place; u of shape (steps, THRUSTERS) of reals. */
void fly(const Plant *m, State *state, const real *u, const Water *water, double dt, int steps) {
    real decay[N];
    for (int k = 0; k < N; k++) {
        mask slow = m->time_constant[k] > 0;
        real over = decay_over(number(0.5 * dt), pick(slow, m->time_constant[k], number(1)));
        decay[k] = pick(slow, over, number(0));
    }
    for (int k = 0; k < steps; k++) plant_step(m, decay, state, u + k * N, water, dt);
}
