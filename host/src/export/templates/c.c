{{about}}
//
// f(t, x, u, dx) writes the right-hand side dx/dt. Build and run the example at the end, which prints CSV:
//     cc -O2 -std=c99 -o model THIS_FILE -lm && ./model

#include <math.h>
#include <stdio.h>

#define N {{n}}  // coordinates
#define M {{inputs_at_least}}  // inputs (1 at least)

{{constants}}
{{#sign}}

// Sign of x, 0 at 0.
static double sign(double x) { return (double)((x > 0.0) - (x < 0.0)); }
{{/sign}}
{{#wrap}}

// Angle x in [-pi, pi), rad.
static double wrap(double x) {
    const double turn = 6.283185307179586;
    return x - turn*floor(x/turn + 0.5);
}
{{/wrap}}
{{#hat}}

// max(0, 1 - |d|/width), d at its shortest around a period (0: none).
static double hat(double d, double width, double period) {
    if (period > 0.0) d -= period*rint(d/period);
    return fmax(0.0, 1.0 - fabs(d)/width);
}
{{/hat}}
{{#solve}}

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
{{/solve}}

{{#plain}}
// dx/dt at time t (s) for the state x = [{{state}}] and inputs u = [{{input_names}}].
void f(double t, const double x[], const double u[], double dx[]) {
{{/plain}}
{{#events}}
// dx/dt at time t (s) for the state x = [{{state}}] and inputs u = [{{input_names}}].
// held: signs in the dry friction, where an integrator holds them; with NULL those of the rates.
void f_held(double t, const double x[], const double u[], const double held[], double dx[]) {
{{/events}}
    (void)t;
    (void)u;
{{locals}}
    // Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    double matrix[N][N] = { { 0.0 } };
    double right[N] = {0.0};
    double acceleration[N];
{{matrix}}
{{right}}
{{#solve}}
    solve(matrix, right, acceleration);
{{/solve}}
{{#single}}
    acceleration[0] = right[0]/matrix[0][0];
{{/single}}
{{rates_assigned}}
}
{{#events}}

// The same with the signs that the rates have.
void f(double t, const double x[], const double u[], double dx[]) { f_held(t, x, u, NULL, dx); }
{{/events}}

// An example: change it to your needs.
static const double X0[2*N] = { {{initial}} };  // {{state}}
#define STEP_S 5e-5  // step of integration
#define SECONDS 1.0
#define EVERY 40  // steps between two lines

// Inputs at time t.
static void inputs(double t, double u[]) {
    (void)t;
    (void)u;
{{zeros_assigned}}
}
{{#events}}

// Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.
#define K {{switch_count}}
static const double SWITCHES[K][N] = { {{switches}} };  // weights of the rates: the joints' relative velocities

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
{{/events}}

{{#plain}}
static void rate(double t, const double x[], double dx[]) {
    double u[M];
    inputs(t, u);
    f(t, x, u, dx);
}

// State y at t + h: classical Runge-Kutta method of order 4.
static void runge_kutta(double t, const double x[], double h, double y[]) {
#define RATE(t, x, dx) rate(t, x, dx)
{{/plain}}
{{#events}}
static void rate(double t, const double x[], const double modes[], double dx[]) {
    double u[M], held[K];
    inputs(t, u);
    hold(t, x, modes, held);
    f_held(t, x, u, held, dx);
}

// State y at t + h: classical Runge-Kutta method of order 4.
static void runge_kutta(double t, const double x[], double h, const double modes[], double y[]) {
#define RATE(t, x, dx) rate(t, x, modes, dx)
{{/events}}
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
{{#events}}

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
{{/events}}

int main(void) {
    double x[2*N];
    for (int i = 0; i < 2*N; i++) x[i] = X0[i];
{{#events}}
    double modes[K];
    for (int k = 0; k < K; k++) modes[k] = sign(along(k, x + N));
    for (int k = 0; k < K; k++) if (modes[k] == 0.0) modes[k] = released(k, 0.0, x, modes);
{{/events}}
    puts("{{columns}}");
    const long steps = (long)(SECONDS/STEP_S + 0.5);
    for (long i = 0; i <= steps; i++) {
        if (i % EVERY == 0) {
            printf("%.17g", (double)i*STEP_S);
            for (int k = 0; k < 2*N; k++) printf(",%.17g", x[k]);
            puts("");
        }
{{#plain}}
        double y[2*N];
        runge_kutta((double)i*STEP_S, x, STEP_S, y);
        for (int k = 0; k < 2*N; k++) x[k] = y[k];
{{/plain}}
{{#events}}
        step((double)i*STEP_S, x, STEP_S, modes);
{{/events}}
    }
    return 0;
}
