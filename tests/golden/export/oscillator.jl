# Duffing's oscillator, "stiff": equations of motion, identified (method: shooting).
# Written by `whirl export`, version 0.1.0.
#
# State x: x_ (SI unit), v_x (SI unit/s).
# Inputs u: force (SI unit).
# Effects beside the nominal model:
#   cubic-stiffness@x: −k x³; value 1.5 N/m³, standard error 2.0e-1
#
# f(t, x, u) is the right-hand side dx/dt. Run this file to integrate the example at its end, printed as CSV.

const m = 1.0002  # kg; standard error 1.1e-5
const c = 0.3999  # N s/m; standard error 2.2e-4
const k = 40.01  # N/m; standard error 1.2e-3
const k3 = 59.98  # N/m³; standard error 6.5e-3
const F_v = 0.21  # N; standard error not known
const cubic_stiffness_x = 1.5  # strength of cubic-stiffness@x, as it enters the equations

const N = 1  # coordinates

"dx/dt at time t (s) for the state x = [x_, v_x] and inputs u = [force]."
function f(t, x, u)
    x_ = x[1]  # SI unit
    v_x = x[2]  # SI unit/s
    force = u[1]  # SI unit
    # Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    matrix = zeros(N, N)
    right = zeros(N)
    matrix[1, 1] = m
    right[1] =
        -c*v_x -
        k*x_ -
        k3*x_^3 -
        F_v*tanh(2.0*v_x)*exp(-x_^2)/(1.0 + abs(x_)) +
        force -
        cubic_stiffness_x*x_^3
    acceleration = matrix \ right
    return [v_x, acceleration[1]]
end

# An example: change it to your needs.
const X0 = [0.1, 0.0]  # x_, v_x
const STEP_S = 5e-5  # step of integration
const SECONDS = 1.0
const EVERY = 40  # steps between two lines

"Inputs at time t."
inputs(t) = [0.0]

"State at t + h: classical Runge-Kutta method of order 4."
function runge_kutta(t, x, h)
    rate(t, x) = f(t, x, inputs(t))
    k1 = rate(t, x)
    k2 = rate(t + 0.5h, x + 0.5h*k1)
    k3 = rate(t + 0.5h, x + 0.5h*k2)
    k4 = rate(t + h, x + h*k3)
    return x + h/6*(k1 + 2k2 + 2k3 + k4)
end

"Prints the example's solution."
function main()
    x = copy(X0)
    println("t,x_,v_x")
    for i in 0:round(Int, SECONDS/STEP_S)
        i % EVERY == 0 && println(join([i*STEP_S; x], ","))
        x = runge_kutta(i*STEP_S, x, STEP_S)
    end
end

abspath(PROGRAM_FILE) == @__FILE__() && main()
