#!/usr/bin/env python3
# Duffing's oscillator, "stiff": equations of motion, identified (method: shooting).
# Written by `whirl export`, version 0.1.0.
#
# State x: x_ (SI unit), v_x (SI unit/s).
# Inputs u: force (SI unit).
# Effects beside the nominal model:
#   cubic-stiffness@x: −k x³; value 1.5 N/m³, standard error 2.0e-1
#
# f(t, x, u) is the right-hand side dx/dt. Run this file to integrate the example at its end, printed as CSV.

from math import exp, tanh

m = 1.0002  # kg; standard error 1.1e-5
c = 0.3999  # N s/m; standard error 2.2e-4
k = 40.01  # N/m; standard error 1.2e-3
k3 = 59.98  # N/m³; standard error 6.5e-3
F_v = 0.21  # N; standard error not known
cubic_stiffness_x = 1.5  # strength of cubic-stiffness@x, as it enters the equations

N = 1  # coordinates


def f(t, x, u):
    """dx/dt at time t (s) for the state x = [x_, v_x] and inputs u = [force]."""
    x_ = x[0]  # SI unit
    v_x = x[1]  # SI unit/s
    force = u[0]  # SI unit
    # Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    matrix = [[0.0]*N for _ in range(N)]
    right = [0.0]*N
    matrix[0][0] = m
    right[0] = (
        -c*v_x
        - k*x_
        - k3*x_**3
        - F_v*tanh(2.0*v_x)*exp(-x_**2)/(1.0 + abs(x_))
        + force
        - cubic_stiffness_x*x_**3
    )
    acceleration = [right[0]/matrix[0][0]]
    return [v_x, acceleration[0]]


# An example: change it to your needs.
X0 = [0.1, 0.0]  # x_, v_x
STEP_S = 5e-5  # step of integration
SECONDS = 1.0
EVERY = 40  # steps between two lines


def inputs(t):
    """Inputs at time t."""
    return [0.0]


def step(t, x, h):
    """State at t + h: classical Runge-Kutta method of order 4."""
    def rate(t, x):
        return f(t, x, inputs(t))
    k1 = rate(t, x)
    k2 = rate(t + 0.5*h, [x + 0.5*h*k for x, k in zip(x, k1)])
    k3 = rate(t + 0.5*h, [x + 0.5*h*k for x, k in zip(x, k2)])
    k4 = rate(t + h, [x + h*k for x, k in zip(x, k3)])
    return [x + h/6.0*(a + 2.0*b + 2.0*c + d) for x, a, b, c, d in zip(x, k1, k2, k3, k4)]


def main():
    """Prints the example's solution."""
    x = list(X0)
    print("t,x_,v_x")
    for i in range(round(SECONDS/STEP_S) + 1):
        if i % EVERY == 0:
            print(",".join(repr(value) for value in [i*STEP_S] + x))
        x = step(i*STEP_S, x, STEP_S)


if __name__ == "__main__":
    main()
