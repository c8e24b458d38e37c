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

const OMEGA = 31.41592653589793  # rad/s; angular frequency of the drive
const B11 = 0.11316  # no unit; standard error 2.1e-5
const B12 = 0.07071  # no unit; standard error 1.1e-5
const B13 = -0.11047  # no unit; standard error 3.1e-5
const B14 = 1.2e-5  # no unit; standard error 2.9e-5
const C11 = 0.00102  # no unit; standard error 4.0e-6
const C12 = 0.003266  # no unit; standard error 5.0e-6
const B21 = 1.6816  # no unit; standard error 4.0e-4
const B22 = 0.26325  # no unit; standard error 2.2e-5
const B23 = -0.41126  # no unit; standard error 4.1e-5
const B24 = 8e-6  # no unit; standard error 3.8e-5
const C2 = 0.0485  # no unit; standard error 1.1e-5
const quadratic_drag_arm2 = 0.00496  # strength of quadratic-drag@arm2 (2e-7 N m s²), as it enters the equations
const viscous_friction_joint1 = 0.0496  # strength of viscous-friction@joint1 (2e-6 N m s), as it enters the equations
const cogging_joint1_C = 1.3  # strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations
const cogging_joint1_S = -1.8  # strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations

const N = 2  # coordinates

"Angle x in [-pi, pi), rad."
wrap(x) = x - 2pi*floor(x/2pi + 0.5)

"""
dx/dt at time t (s) for the state x = [phi1, phi2, v_phi1, v_phi2] and inputs u = [].

held: signs in the dry friction, where an integrator holds them; otherwise those of the rates.
"""
function f(t, x, u, held=nothing)
    phi1 = x[1]  # rad
    phi2 = x[2]  # rad
    v_phi1 = x[3]  # rad/s
    v_phi2 = x[4]  # rad/s
    tau = OMEGA*t  # rad; phase of the drive
    phi1_tau = v_phi1/OMEGA  # d phi1/d tau
    phi2_tau = v_phi2/OMEGA  # d phi2/d tau
    s1 = isnothing(held) ? sign(v_phi1) : held[1]  # sign in the dry friction
    # Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    matrix = zeros(N, N)
    right = zeros(N)
    matrix[1, 1] = 1.0
    matrix[1, 2] = B11*cos(phi2 - phi1)
    matrix[2, 1] = B21*cos(phi2 - phi1)
    matrix[2, 2] = 1.0
    right[1] =
        B11*phi2_tau^2*sin(phi2 - phi1) -
        B12*sin(phi1) -
        B13*sin(phi1)*cos(tau) -
        B14*sin(phi1)*sin(tau) -
        C11*s1 -
        C12*(phi1_tau - phi2_tau) -
        viscous_friction_joint1*6.818211905903273e-5*v_phi1 -
        cogging_joint1_C*6.818211905903273e-5*sin(7.0*wrap(phi1)) -
        cogging_joint1_S*6.818211905903273e-5*cos(7.0*wrap(phi1))
    right[2] =
        -B21*phi1_tau^2*sin(phi2 - phi1) -
        B22*sin(phi2) -
        B23*sin(phi2)*cos(tau) -
        B24*sin(phi2)*sin(tau) -
        C2*(phi2_tau - phi1_tau) -
        quadratic_drag_arm2*0.0010132118364233778*v_phi2*abs(v_phi2)
    acceleration = matrix \ right
    return [v_phi1, v_phi2, OMEGA^2*acceleration[1], OMEGA^2*acceleration[2]]
end

# An example: change it to your needs.
const X0 = [1.0, 1.0, 0.0, 0.0]  # phi1, phi2, v_phi1, v_phi2
const STEP_S = 5e-5  # step of integration
const SECONDS = 1.0
const EVERY = 40  # steps between two lines

"Inputs at time t."
inputs(t) = []

# Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.
const SWITCHES = reshape(Float64[1.0 0.0], :, N)  # weights of the rates: the joints' relative velocities

"Relative velocities of the joints."
along(x) = SWITCHES*x[N+1:end]

"Accelerations of the joints with these signs."
gains(t, x, held) = SWITCHES*f(t, x, inputs(t), held)[N+1:end]

"Signs in the dry friction: 1 or -1 where a joint slides; where it sticks (mode 0), what keeps it at rest."
function hold(t, x, modes)
    held = copy(modes)
    for again in eachindex(modes), k in findall(modes .== 0)
        held[k] = -1.0
        a = gains(t, x, held)[k]
        held[k] = 1.0
        b = gains(t, x, held)[k]
        held[k] = (a + b)/(a - b)
    end
    return held
end

"Joints that slide against their sign, or stick by more than dry friction can hold."
function turned(t, x, modes)
    held, v = hold(t, x, modes), along(x)
    return [k for k in eachindex(modes) if (modes[k] == 0 ? abs(held[k]) > 1 : modes[k]*v[k] < 0)]
end

"How joint k goes on from rest: its sign, or 0 where it sticks."
function released(k, t, x, modes)
    trial = copy(modes)
    for mode in (1.0, -1.0)
        trial[k] = mode
        mode*gains(t, x, hold(t, x, trial))[k] > 0 && return mode
    end
    return 0.0
end

"State at t + h; modes are changed where joints reverse, stick or break loose."
function step(t, x, h, modes)
    last = t + h
    for events in 1:24
        y = runge_kutta(t, x, last - t, modes)
        isempty(turned(last, y, modes)) && return y
        low, high = 0.0, last - t
        for bisection in 1:50
            middle = 0.5*(low + high)
            if isempty(turned(t + middle, runge_kutta(t, x, middle, modes), modes))
                low = middle
            else
                high = middle
            end
        end
        x = runge_kutta(t, x, high, modes)
        t += high
        for k in turned(t, x, modes)
            modes[k] = released(k, t, x, modes)
        end
    end
    return runge_kutta(t, x, last - t, modes)
end

"State at t + h: classical Runge-Kutta method of order 4."
function runge_kutta(t, x, h, modes)
    rate(t, x) = f(t, x, inputs(t), hold(t, x, modes))
    k1 = rate(t, x)
    k2 = rate(t + 0.5h, x + 0.5h*k1)
    k3 = rate(t + 0.5h, x + 0.5h*k2)
    k4 = rate(t + h, x + h*k3)
    return x + h/6*(k1 + 2k2 + 2k3 + k4)
end

"Prints the example's solution."
function main()
    x = copy(X0)
    modes = sign.(along(x))
    for k in findall(modes .== 0)
        modes[k] = released(k, 0.0, x, modes)
    end
    println("t,phi1,phi2,v_phi1,v_phi2")
    for i in 0:round(Int, SECONDS/STEP_S)
        i % EVERY == 0 && println(join([i*STEP_S; x], ","))
        x = step(i*STEP_S, x, STEP_S, modes)
    end
end

abspath(PROGRAM_FILE) == @__FILE__() && main()
