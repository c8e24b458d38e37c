{{about}}
#
# f(t, x, u) is the right-hand side dx/dt. Run this file to integrate the example at its end, printed as CSV.

{{constants}}

const N = {{n}}  # coordinates
{{#wrap}}

"Angle x in [-pi, pi), rad."
wrap(x) = x - 2pi*floor(x/2pi + 0.5)
{{/wrap}}
{{#hat}}

"max(0, 1 - |d|/width), d at its shortest around a period (0: none)."
hat(d, width, period) = max(0.0, 1.0 - abs(period > 0 ? d - period*round(d/period) : d)/width)
{{/hat}}

{{#plain}}
"dx/dt at time t (s) for the state x = [{{state}}] and inputs u = [{{input_names}}]."
function f(t, x, u)
{{/plain}}
{{#events}}
"""
dx/dt at time t (s) for the state x = [{{state}}] and inputs u = [{{input_names}}].

held: signs in the dry friction, where an integrator holds them; otherwise those of the rates.
"""
function f(t, x, u, held=nothing)
{{/events}}
{{locals}}
    # Each equation of the model, solved for its accelerations: matrix * acceleration = right.
    matrix = zeros(N, N)
    right = zeros(N)
{{matrix}}
{{right}}
    acceleration = matrix \ right
    return [{{rates}}]
end

# An example: change it to your needs.
const X0 = [{{initial}}]  # {{state}}
const STEP_S = 5e-5  # step of integration
const SECONDS = 1.0
const EVERY = 40  # steps between two lines

"Inputs at time t."
inputs(t) = [{{zeros}}]

{{#plain}}
"State at t + h: classical Runge-Kutta method of order 4."
function runge_kutta(t, x, h)
    rate(t, x) = f(t, x, inputs(t))
{{/plain}}
{{#events}}
# Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.
const SWITCHES = reshape(Float64[{{switches}}], :, N)  # weights of the rates: the joints' relative velocities

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
{{/events}}
    k1 = rate(t, x)
    k2 = rate(t + 0.5h, x + 0.5h*k1)
    k3 = rate(t + 0.5h, x + 0.5h*k2)
    k4 = rate(t + h, x + h*k3)
    return x + h/6*(k1 + 2k2 + 2k3 + k4)
end

"Prints the example's solution."
function main()
    x = copy(X0)
{{#events}}
    modes = sign.(along(x))
    for k in findall(modes .== 0)
        modes[k] = released(k, 0.0, x, modes)
    end
{{/events}}
    println("{{columns}}")
    for i in 0:round(Int, SECONDS/STEP_S)
        i % EVERY == 0 && println(join([i*STEP_S; x], ","))
{{#plain}}
        x = runge_kutta(i*STEP_S, x, STEP_S)
{{/plain}}
{{#events}}
        x = step(i*STEP_S, x, STEP_S, modes)
{{/events}}
    end
end

abspath(PROGRAM_FILE) == @__FILE__() && main()
