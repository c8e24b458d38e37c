#!/usr/bin/env python3
# double pendulum on a shaker: equations of motion, identified (method: explain).
# Written by `whirl export`, version 0.1.0.
#
# State x: phi1 (rad), phi2 (rad), v_phi1 (rad/s), v_phi2 (rad/s).
# Drive: 5 Hz, phase tau = OMEGA t.
# Effects beside the nominal model:
#   quadratic-drag@arm2: −k ω |ω|; value 2e-7 N m s², standard error 5.0e-10
#   viscous-friction@joint1: −c v; value 2e-6 N m s, standard error 1.0e-7
#   cogging@joint1: −A sin(n x + ψ); value 9e-5 N m, standard error 1.0e-6, n = 7, psi = -0.9454
#   zero-offset@encoder2: θ + b; value 0.01 rad, standard error 2.0e-5 (changes what the sensor shows, not the
#     motion: it is not in the equations)
#
# f(t, x, u) is the right-hand side dx/dt. Run this file to integrate the example at its end, printed as CSV.

from math import cos, floor, pi, sin

OMEGA = 31.41592653589793  # rad/s; angular frequency of the drive
B11 = 0.11316  # no unit; standard error 2.1e-5
B12 = 0.07071  # no unit; standard error 1.1e-5
B13 = -0.11047  # no unit; standard error 3.1e-5
B14 = 1.2e-5  # no unit; standard error 2.9e-5
C11 = 0.00102  # no unit; standard error 4.0e-6
C12 = 0.003266  # no unit; standard error 5.0e-6
B21 = 1.6816  # no unit; standard error 4.0e-4
B22 = 0.26325  # no unit; standard error 2.2e-5
B23 = -0.41126  # no unit; standard error 4.1e-5
B24 = 8e-6  # no unit; standard error 3.8e-5
C2 = 0.0485  # no unit; standard error 1.1e-5
quadratic_drag_arm2 = 0.00496  # strength of quadratic-drag@arm2 (2e-7 N m s²), as it enters the equations
viscous_friction_joint1 = 0.0496  # strength of viscous-friction@joint1 (2e-6 N m s), as it enters the equations
cogging_joint1_C = 1.3  # strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations
cogging_joint1_S = -1.8  # strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations

N = 2  # coordinates


def sign(x):
    """Sign of x, 0 at 0."""
    return float(x > 0.0) - float(x < 0.0)


def wrap(x):
    """Angle x in [-pi, pi), rad."""
    return x - 2.0*pi*floor(x/(2.0*pi) + 0.5)


def solve(matrix, right):
    """Solution of matrix y = right, by elimination with partial pivoting."""
    a = [row + [b] for row, b in zip(matrix, right)]
    for k in range(N):
        pivot = max(range(k, N), key=lambda i: abs(a[i][k]))
        a[k], a[pivot] = a[pivot], a[k]
        for i in range(k + 1, N):
            share = a[i][k]/a[k][k]
            for j in range(k, N + 1):
                a[i][j] -= share*a[k][j]
    y = [0.0]*N
    for k in reversed(range(N)):
        y[k] = (a[k][N] - sum(a[k][j]*y[j] for j in range(k + 1, N)))/a[k][k]
    return y


def f(t, x, u, held=None):
    """dx/dt at time t (s) for the state x = [phi1, phi2, v_phi1, v_phi2] and inputs u = [].

    held: signs in the dry friction, where an integrator holds them; otherwise those of the rates.
    """
    phi1 = x[0]  # rad
    phi2 = x[1]  # rad
    v_phi1 = x[2]  # rad/s
    v_phi2 = x[3]  # rad/s
    tau = OMEGA*t  # rad; phase of the drive
    phi1_tau = v_phi1/OMEGA  # d phi1/d tau
    phi2_tau = v_phi2/OMEGA  # d phi2/d tau
    s1 = sign(v_phi1) if held is None else held[0]  # sign in the dry friction
    # Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    matrix = [[0.0]*N for _ in range(N)]
    right = [0.0]*N
    matrix[0][0] = 1.0
    matrix[0][1] = B11*cos(phi2 - phi1)
    matrix[1][0] = B21*cos(phi2 - phi1)
    matrix[1][1] = 1.0
    right[0] = (
        B11*phi2_tau**2*sin(phi2 - phi1)
        - B12*sin(phi1)
        - B13*sin(phi1)*cos(tau)
        - B14*sin(phi1)*sin(tau)
        - C11*s1
        - C12*(phi1_tau - phi2_tau)
        - viscous_friction_joint1*6.818211905903273e-5*v_phi1
        - cogging_joint1_C*6.818211905903273e-5*sin(7.0*wrap(phi1))
        - cogging_joint1_S*6.818211905903273e-5*cos(7.0*wrap(phi1))
    )
    right[1] = (
        -B21*phi1_tau**2*sin(phi2 - phi1)
        - B22*sin(phi2)
        - B23*sin(phi2)*cos(tau)
        - B24*sin(phi2)*sin(tau)
        - C2*(phi2_tau - phi1_tau)
        - quadratic_drag_arm2*0.0010132118364233778*v_phi2*abs(v_phi2)
    )
    acceleration = solve(matrix, right)
    return [v_phi1, v_phi2, OMEGA**2*acceleration[0], OMEGA**2*acceleration[1]]


# An example: change it to your needs.
X0 = [1.0, 1.0, 0.0, 0.0]  # phi1, phi2, v_phi1, v_phi2
STEP_S = 5e-5  # step of integration
SECONDS = 1.0
EVERY = 40  # steps between two lines


def inputs(t):
    """Inputs at time t."""
    return []


# Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.
SWITCHES = [[1.0, 0.0]]  # weights of the rates: the joints' relative velocities


def along(k, rates):
    """Relative velocity (or acceleration) of joint k."""
    return sum(w*r for w, r in zip(SWITCHES[k], rates))


def hold(t, x, modes):
    """Signs in the dry friction: 1 or -1 where a joint slides; where it sticks (mode 0), what keeps it at rest."""
    held = list(modes)
    for _ in modes:
        for k, mode in enumerate(modes):
            if mode == 0.0:
                held[k] = -1.0
                a = along(k, f(t, x, inputs(t), held)[N:])
                held[k] = 1.0
                b = along(k, f(t, x, inputs(t), held)[N:])
                held[k] = (a + b)/(a - b)
    return held


def turned(t, x, modes):
    """Joints that slide against their sign, or stick by more than dry friction can hold."""
    held = hold(t, x, modes)
    return [k for k, mode in enumerate(modes)
            if (mode*along(k, x[N:]) < 0.0 if mode != 0.0 else abs(held[k]) > 1.0)]


def released(k, t, x, modes):
    """How joint k goes on from rest: its sign, or 0 where it sticks."""
    modes = list(modes)
    for modes[k] in (1.0, -1.0):
        if modes[k]*along(k, f(t, x, inputs(t), hold(t, x, modes))[N:]) > 0.0:
            return modes[k]
    return 0.0


def runge_kutta(t, x, h, modes):
    """State at t + h: classical Runge-Kutta method of order 4."""
    def rate(t, x):
        return f(t, x, inputs(t), hold(t, x, modes))
    k1 = rate(t, x)
    k2 = rate(t + 0.5*h, [x + 0.5*h*k for x, k in zip(x, k1)])
    k3 = rate(t + 0.5*h, [x + 0.5*h*k for x, k in zip(x, k2)])
    k4 = rate(t + h, [x + h*k for x, k in zip(x, k3)])
    return [x + h/6.0*(a + 2.0*b + 2.0*c + d) for x, a, b, c, d in zip(x, k1, k2, k3, k4)]


def step(t, x, h, modes):
    """State at t + h; modes are changed where joints reverse, stick or break loose."""
    end = t + h
    for _ in range(24):
        y = runge_kutta(t, x, end - t, modes)
        if not turned(end, y, modes):
            return y
        low, high = 0.0, end - t
        for _ in range(50):
            middle = 0.5*(low + high)
            if turned(t + middle, runge_kutta(t, x, middle, modes), modes):
                high = middle
            else:
                low = middle
        x = runge_kutta(t, x, high, modes)
        t += high
        for k in turned(t, x, modes):
            modes[k] = released(k, t, x, modes)
    return runge_kutta(t, x, end - t, modes)


def main():
    """Prints the example's solution."""
    x = list(X0)
    modes = [sign(along(k, x[N:])) for k in range(len(SWITCHES))]
    for k, mode in enumerate(modes):
        if mode == 0.0:
            modes[k] = released(k, 0.0, x, modes)
    print("t,phi1,phi2,v_phi1,v_phi2")
    for i in range(round(SECONDS/STEP_S) + 1):
        if i % EVERY == 0:
            print(",".join(repr(value) for value in [i*STEP_S] + x))
        x = step(i*STEP_S, x, STEP_S, modes)


if __name__ == "__main__":
    main()
