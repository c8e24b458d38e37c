// double pendulum on a shaker: equations of motion, identified (method: explain).
// Written by `whirl export`, version 0.1.0.
//
// State x: phi1 (rad), phi2 (rad), v_phi1 (rad/s), v_phi2 (rad/s).
// Drive: 5 Hz, phase tau = OMEGA t.
// Effects beside the nominal model:
//   quadratic-drag@arm2: −k ω |ω|; value 2e-7 N m s², standard error 5.0e-10
//   viscous-friction@joint1: −c v; value 2e-6 N m s, standard error 1.0e-7
//   cogging@joint1: −A sin(n x + ψ); value 9e-5 N m, standard error 1.0e-6, n = 7, psi = -0.9454
//   zero-offset@encoder2: θ + b; value 0.01 rad, standard error 2.0e-5 (changes what the sensor shows, not the
//     motion: it is not in the equations)
//
// f(t, x, u, dx) writes the right-hand side dx/dt. Build and run the example at the end, which prints CSV:
//     cc -O2 -std=c99 -o model THIS_FILE -lm && ./model

#include <math.h>
#include <stdio.h>

#define N 2  // coordinates
#define M 1  // inputs (1 at least)

static const double OMEGA = 31.41592653589793;  // rad/s; angular frequency of the drive
static const double B11 = 0.11316;  // no unit; standard error 2.1e-5
static const double B12 = 0.07071;  // no unit; standard error 1.1e-5
static const double B13 = -0.11047;  // no unit; standard error 3.1e-5
static const double B14 = 1.2e-5;  // no unit; standard error 2.9e-5
static const double C11 = 0.00102;  // no unit; standard error 4.0e-6
static const double C12 = 0.003266;  // no unit; standard error 5.0e-6
static const double B21 = 1.6816;  // no unit; standard error 4.0e-4
static const double B22 = 0.26325;  // no unit; standard error 2.2e-5
static const double B23 = -0.41126;  // no unit; standard error 4.1e-5
static const double B24 = 8e-6;  // no unit; standard error 3.8e-5
static const double C2 = 0.0485;  // no unit; standard error 1.1e-5
static const double quadratic_drag_arm2 = 0.00496;  // strength of quadratic-drag@arm2 (2e-7 N m s²), as it enters the equations
static const double viscous_friction_joint1 = 0.0496;  // strength of viscous-friction@joint1 (2e-6 N m s), as it enters the equations
static const double cogging_joint1_C = 1.3;  // strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations
static const double cogging_joint1_S = -1.8;  // strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations

// Sign of x, 0 at 0.
static double sign(double x) { return (double)((x > 0.0) - (x < 0.0)); }

// Angle x in [-pi, pi), rad.
static double wrap(double x) {
    const double turn = 6.283185307179586;
    return x - turn*floor(x/turn + 0.5);
}

// Solution y of a y = b, by elimination with partial pivoting; a and b are used up.
static void solve(double a[N][N], double b[N], double y[N]) {
    for (int k = 0; k < N; k++) {
        int pivot = k;
        for (int i = k + 1; i < N; i++) if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
        for (int j = k; j < N; j++) { const double kept = a[k][j]; a[k][j] = a[pivot][j]; a[pivot][j] = kept; }
        { const double kept = b[k]; b[k] = b[pivot]; b[pivot] = kept; }
        for (int i = k + 1; i < N; i++) {
            const double share = a[i][k]/a[k][k];
            for (int j = k; j < N; j++) a[i][j] -= share*a[k][j];
            b[i] -= share*b[k];
        }
    }
    for (int k = N - 1; k >= 0; k--) {
        y[k] = b[k];
        for (int j = k + 1; j < N; j++) y[k] -= a[k][j]*y[j];
        y[k] /= a[k][k];
    }
}

// dx/dt at time t (s) for the state x = [phi1, phi2, v_phi1, v_phi2] and inputs u = [].
// held: signs in the dry friction, where an integrator holds them; with NULL those of the rates.
void f_held(double t, const double x[], const double u[], const double held[], double dx[]) {
    (void)t;
    (void)u;
    const double phi1 = x[0];  // rad
    const double phi2 = x[1];  // rad
    const double v_phi1 = x[2];  // rad/s
    const double v_phi2 = x[3];  // rad/s
    const double tau = OMEGA*t;  // rad; phase of the drive
    const double phi1_tau = v_phi1/OMEGA;  // d phi1/d tau
    const double phi2_tau = v_phi2/OMEGA;  // d phi2/d tau
    const double s1 = held ? held[0] : sign(v_phi1);  // sign in the dry friction
    // Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    double matrix[N][N] = { { 0.0 } };
    double right[N] = {0.0};
    double acceleration[N];
    matrix[0][0] = 1.0;
    matrix[0][1] = B11*cos(phi2 - phi1);
    matrix[1][0] = B21*cos(phi2 - phi1);
    matrix[1][1] = 1.0;
    right[0] = B11*pow(phi2_tau, 2)*sin(phi2 - phi1)
        - B12*sin(phi1)
        - B13*sin(phi1)*cos(tau)
        - B14*sin(phi1)*sin(tau)
        - C11*s1
        - C12*(phi1_tau - phi2_tau)
        - viscous_friction_joint1*6.818211905903273e-5*v_phi1
        - cogging_joint1_C*6.818211905903273e-5*sin(7.0*wrap(phi1))
        - cogging_joint1_S*6.818211905903273e-5*cos(7.0*wrap(phi1));
    right[1] = -B21*pow(phi1_tau, 2)*sin(phi2 - phi1)
        - B22*sin(phi2)
        - B23*sin(phi2)*cos(tau)
        - B24*sin(phi2)*sin(tau)
        - C2*(phi2_tau - phi1_tau)
        - quadratic_drag_arm2*0.0010132118364233778*v_phi2*fabs(v_phi2);
    solve(matrix, right, acceleration);
    dx[0] = v_phi1;
    dx[1] = v_phi2;
    dx[2] = pow(OMEGA, 2)*acceleration[0];
    dx[3] = pow(OMEGA, 2)*acceleration[1];
}

// The same with the signs that the rates have.
void f(double t, const double x[], const double u[], double dx[]) { f_held(t, x, u, NULL, dx); }

// An example: change it to your needs.
static const double X0[2*N] = { 1.0, 1.0, 0.0, 0.0 };  // phi1, phi2, v_phi1, v_phi2
#define STEP_S 5e-5  // step of integration
#define SECONDS 1.0
#define EVERY 40  // steps between two lines

// Inputs at time t.
static void inputs(double t, double u[]) {
    (void)t;
    (void)u;
}

// Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.
#define K 1
static const double SWITCHES[K][N] = { {1.0, 0.0} };  // weights of the rates: the joints' relative velocities

// Relative velocity (or acceleration) of joint k.
static double along(int k, const double rates[]) {
    double sum = 0.0;
    for (int i = 0; i < N; i++) sum += SWITCHES[k][i]*rates[i];
    return sum;
}

// Acceleration of joint k with these signs.
static double gains(int k, double t, const double x[], const double held[]) {
    double u[M], dx[2*N];
    inputs(t, u);
    f_held(t, x, u, held, dx);
    return along(k, dx + N);
}

// Signs in the dry friction: 1 or -1 where a joint slides; where it sticks (mode 0), what keeps it at rest.
static void hold(double t, const double x[], const double modes[], double held[]) {
    for (int k = 0; k < K; k++) held[k] = modes[k];
    for (int round = 0; round < K; round++) {
        for (int k = 0; k < K; k++) {
            if (modes[k] != 0.0) continue;
            held[k] = -1.0;
            const double a = gains(k, t, x, held);
            held[k] = 1.0;
            const double b = gains(k, t, x, held);
            held[k] = (a + b)/(a - b);
        }
    }
}

// Whether joint k slides against its sign, or sticks by more than dry friction can hold.
static int turned(int k, double t, const double x[], const double modes[]) {
    double held[K];
    if (modes[k] != 0.0) return modes[k]*along(k, x + N) < 0.0;
    hold(t, x, modes, held);
    return fabs(held[k]) > 1.0;
}

static int any_turned(double t, const double x[], const double modes[]) {
    for (int k = 0; k < K; k++) if (turned(k, t, x, modes)) return 1;
    return 0;
}

// How joint k goes on from rest: its sign, or 0 where it sticks.
static double released(int k, double t, const double x[], const double modes[]) {
    double trial[K], held[K];
    for (int i = 0; i < K; i++) trial[i] = modes[i];
    for (trial[k] = 1.0; trial[k] > -2.0; trial[k] -= 2.0) {
        hold(t, x, trial, held);
        if (trial[k]*gains(k, t, x, held) > 0.0) return trial[k];
    }
    return 0.0;
}

static void rate(double t, const double x[], const double modes[], double dx[]) {
    double u[M], held[K];
    inputs(t, u);
    hold(t, x, modes, held);
    f_held(t, x, u, held, dx);
}

// State y at t + h: classical Runge-Kutta method of order 4.
static void runge_kutta(double t, const double x[], double h, const double modes[], double y[]) {
#define RATE(t, x, dx) rate(t, x, modes, dx)
    double a[2*N], b[2*N], c[2*N], d[2*N], z[2*N];
    RATE(t, x, a);
    for (int i = 0; i < 2*N; i++) z[i] = x[i] + 0.5*h*a[i];
    RATE(t + 0.5*h, z, b);
    for (int i = 0; i < 2*N; i++) z[i] = x[i] + 0.5*h*b[i];
    RATE(t + 0.5*h, z, c);
    for (int i = 0; i < 2*N; i++) z[i] = x[i] + h*c[i];
    RATE(t + h, z, d);
    for (int i = 0; i < 2*N; i++) y[i] = x[i] + h/6.0*(a[i] + 2.0*b[i] + 2.0*c[i] + d[i]);
}

// State x at t + h; modes are changed where joints reverse, stick or break loose.
static void step(double t, double x[], double h, double modes[]) {
    const double end = t + h;
    double y[2*N];
    for (int events = 0; events < 24; events++) {
        runge_kutta(t, x, end - t, modes, y);
        if (!any_turned(end, y, modes)) break;
        double low = 0.0, high = end - t;
        for (int i = 0; i < 50; i++) {
            const double middle = 0.5*(low + high);
            runge_kutta(t, x, middle, modes, y);
            if (any_turned(t + middle, y, modes)) high = middle; else low = middle;
        }
        runge_kutta(t, x, high, modes, y);
        t += high;
        int which[K];
        for (int k = 0; k < K; k++) which[k] = turned(k, t, y, modes);
        for (int k = 0; k < K; k++) if (which[k]) modes[k] = released(k, t, y, modes);
        for (int i = 0; i < 2*N; i++) x[i] = y[i];
        runge_kutta(t, x, end - t, modes, y);
    }
    for (int i = 0; i < 2*N; i++) x[i] = y[i];
}

int main(void) {
    double x[2*N];
    for (int i = 0; i < 2*N; i++) x[i] = X0[i];
    double modes[K];
    for (int k = 0; k < K; k++) modes[k] = sign(along(k, x + N));
    for (int k = 0; k < K; k++) if (modes[k] == 0.0) modes[k] = released(k, 0.0, x, modes);
    puts("t,phi1,phi2,v_phi1,v_phi2");
    const long steps = (long)(SECONDS/STEP_S + 0.5);
    for (long i = 0; i <= steps; i++) {
        if (i % EVERY == 0) {
            printf("%.17g", (double)i*STEP_S);
            for (int k = 0; k < 2*N; k++) printf(",%.17g", x[k]);
            puts("");
        }
        step((double)i*STEP_S, x, STEP_S, modes);
    }
    return 0;
}
