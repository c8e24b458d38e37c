#!/usr/bin/env python3
{{about}}
#
# f(t, x, u) is the right-hand side dx/dt. Run this file to integrate the example at its end, printed as CSV.

{{import}}

{{constants}}

N = {{n}}  # coordinates
{{#sign}}


def sign(x):
    """Sign of x, 0 at 0."""
    return float(x > 0.0) - float(x < 0.0)
{{/sign}}
{{#wrap}}


def wrap(x):
    """Angle x in [-pi, pi), rad."""
    return x - 2.0*pi*floor(x/(2.0*pi) + 0.5)
{{/wrap}}
{{#hat}}


def hat(d, width, period):
    """max(0, 1 - |d|/width), d at its shortest around a period (0: none)."""
    if period > 0.0:
        d -= period*round(d/period)
    return max(0.0, 1.0 - abs(d)/width)
{{/hat}}
{{#solve}}


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
{{/solve}}


{{#plain}}
def f(t, x, u):
    """dx/dt at time t (s) for the state x = [{{state}}] and inputs u = [{{input_names}}]."""
{{/plain}}
{{#events}}
def f(t, x, u, held=None):
    """dx/dt at time t (s) for the state x = [{{state}}] and inputs u = [{{input_names}}].

    held: signs in the dry friction, where an integrator holds them; otherwise those of the rates.
    """
{{/events}}
{{locals}}
    # Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    matrix = [[0.0]*N for _ in range(N)]
    right = [0.0]*N
{{matrix}}
{{right}}
{{#solve}}
    acceleration = solve(matrix, right)
{{/solve}}
{{#single}}
    acceleration = [right[0]/matrix[0][0]]
{{/single}}
    return [{{rates}}]


# An example: change it to your needs.
X0 = [{{initial}}]  # {{state}}
STEP_S = 5e-5  # step of integration
SECONDS = 1.0
EVERY = 40  # steps between two lines


def inputs(t):
    """Inputs at time t."""
    return [{{zeros}}]
{{#plain}}


def step(t, x, h):
    """State at t + h: classical Runge-Kutta method of order 4."""
    def rate(t, x):
        return f(t, x, inputs(t))
    k1 = rate(t, x)
    k2 = rate(t + 0.5*h, [x + 0.5*h*k for x, k in zip(x, k1)])
    k3 = rate(t + 0.5*h, [x + 0.5*h*k for x, k in zip(x, k2)])
    k4 = rate(t + h, [x + h*k for x, k in zip(x, k3)])
    return [x + h/6.0*(a + 2.0*b + 2.0*c + d) for x, a, b, c, d in zip(x, k1, k2, k3, k4)]
{{/plain}}
{{#events}}


# Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.
SWITCHES = [{{switches}}]  # weights of the rates: the joints' relative velocities


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
{{/events}}


def main():
    """Prints the example's solution."""
    x = list(X0)
{{#events}}
    modes = [sign(along(k, x[N:])) for k in range(len(SWITCHES))]
    for k, mode in enumerate(modes):
        if mode == 0.0:
            modes[k] = released(k, 0.0, x, modes)
{{/events}}
    print("{{columns}}")
    for i in range(round(SECONDS/STEP_S) + 1):
        if i % EVERY == 0:
            print(",".join(repr(value) for value in [i*STEP_S] + x))
{{#plain}}
        x = step(i*STEP_S, x, STEP_S)
{{/plain}}
{{#events}}
        x = step(i*STEP_S, x, STEP_S, modes)
{{/events}}


if __name__ == "__main__":
    main()
