// Duffing's oscillator, "stiff": equations of motion, identified (method: shooting).
// Written by `whirl export`, version 0.1.0.
//
// State x: x_ (SI unit), v_x (SI unit/s).
// Inputs u: force (SI unit).
// Effects beside the nominal model:
//   cubic-stiffness@x: −k x³; value 1.5 N/m³, standard error 2.0e-1
//
// f(t, x, u, dx) writes the right-hand side dx/dt. Build and run the example at the end, which prints CSV:
//     cc -O2 -std=c99 -o model THIS_FILE -lm && ./model

#include <math.h>
#include <stdio.h>

#define N 1  // coordinates
#define M 1  // inputs (1 at least)

static const double m = 1.0002;  // kg; standard error 1.1e-5
static const double c = 0.3999;  // N s/m; standard error 2.2e-4
static const double k_ = 40.01;  // N/m; standard error 1.2e-3
static const double k3 = 59.98;  // N/m³; standard error 6.5e-3
static const double F_v = 0.21;  // N; standard error not known
static const double cubic_stiffness_x = 1.5;  // strength of cubic-stiffness@x, as it enters the equations

// dx/dt at time t (s) for the state x = [x_, v_x] and inputs u = [force].
void f(double t, const double x[], const double u[], double dx[]) {
    (void)t;
    (void)u;
    const double x_ = x[0];  // SI unit
    const double v_x = x[1];  // SI unit/s
    const double force = u[0];  // SI unit
    // Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    double matrix[N][N] = { { 0.0 } };
    double right[N] = {0.0};
    double acceleration[N];
    matrix[0][0] = m;
    right[0] = -c*v_x
        - k_*x_
        - k3*pow(x_, 3)
        - F_v*tanh(2.0*v_x)*exp(-pow(x_, 2))/(1.0 + fabs(x_))
        + force
        - cubic_stiffness_x*pow(x_, 3);
    acceleration[0] = right[0]/matrix[0][0];
    dx[0] = v_x;
    dx[1] = acceleration[0];
}

// An example: change it to your needs.
static const double X0[2*N] = { 0.1, 0.0 };  // x_, v_x
#define STEP_S 5e-5  // step of integration
#define SECONDS 1.0
#define EVERY 40  // steps between two lines

// Inputs at time t.
static void inputs(double t, double u[]) {
    (void)t;
    (void)u;
    u[0] = 0.0;
}

static void rate(double t, const double x[], double dx[]) {
    double u[M];
    inputs(t, u);
    f(t, x, u, dx);
}

// State y at t + h: classical Runge-Kutta method of order 4.
static void runge_kutta(double t, const double x[], double h, double y[]) {
#define RATE(t, x, dx) rate(t, x, dx)
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

int main(void) {
    double x[2*N];
    for (int i = 0; i < 2*N; i++) x[i] = X0[i];
    puts("t,x_,v_x");
    const long steps = (long)(SECONDS/STEP_S + 0.5);
    for (long i = 0; i <= steps; i++) {
        if (i % EVERY == 0) {
            printf("%.17g", (double)i*STEP_S);
            for (int k = 0; k < 2*N; k++) printf(",%.17g", x[k]);
            puts("");
        }
        double y[2*N];
        runge_kutta((double)i*STEP_S, x, STEP_S, y);
        for (int k = 0; k < 2*N; k++) x[k] = y[k];
    }
    return 0;
}
