function [t, x, f] = {{name}}(seconds, step_s, x)
{{about}}
%
% [t, x, f] = {{name}} integrates the example below and returns times t (s), states x (one row each) and
% the right-hand side f(t, x, u); {{name}}(seconds, step_s, x0) takes another length, step and initial state.

  if nargin < 1, seconds = 1; end
  if nargin < 2, step_s = 1e-4; end
  if nargin < 3, x = [{{initial_column}}]; end  % {{state}}
  f = @right_hand_side;
  count = round(seconds/step_s) + 1;
  t = (0:count - 1)'*step_s;
  states = zeros(count, numel(x));
  x = x(:);
{{#events}}
  weights = switches();
  modes = sign(weights*x({{n}} + 1:end));
  for k = find(modes' == 0)
    modes(k) = released(k, 0, x, modes);
  end
{{/events}}
  for i = 1:count
    states(i, :) = x';
{{#plain}}
    x = runge_kutta(t(i), x, step_s);
{{/plain}}
{{#events}}
    [x, modes] = step(t(i), x, step_s, modes);
{{/events}}
  end
  x = states;
end

function u = inputs(t)  % inputs at time t: change them to your needs
  u = [{{zero_column}}];
end

{{#plain}}
function dx = right_hand_side(t, x, u)
{{/plain}}
{{#events}}
function dx = right_hand_side(t, x, u, held)
  % held: signs in the dry friction, where an integrator holds them; otherwise those of the rates.
  if nargin < 4, held = sign(switches()*x({{n}} + 1:end)); end
{{/events}}
  % dx/dt at time t (s) for the state x = [{{state}}] and inputs u = [{{input_names}}].
{{constants}}

{{locals}}
  % Each equation of the model, solved for its accelerations: matrix * acceleration = right.
  matrix = zeros({{n}});
  right = zeros({{n}}, 1);
{{matrix}}
{{right}}
  acceleration = matrix\right;
  dx = [{{rates_column}}];
end
{{#wrap}}

function y = wrap(x)  % angle x in [-pi, pi), rad
  y = x - 2*pi*floor(x/(2*pi) + 0.5);
end
{{/wrap}}
{{#hat}}

function y = hat(d, width, period)  % max(0, 1 - |d|/width), d at its shortest around a period (0: none)
  if period > 0, d = d - period*round(d/period); end
  y = max(0, 1 - abs(d)/width);
end
{{/hat}}
{{#plain}}

function y = runge_kutta(t, x, h)  % state at t + h: classical Runge-Kutta method of order 4
  rate = @(t, x) right_hand_side(t, x, inputs(t));
{{/plain}}
{{#events}}

% Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.

function weights = switches()  % weights of the rates: the joints' relative velocities
  weights = [{{switches}}];
end

function a = gains(t, x, held)  % accelerations of the joints with these signs
  dx = right_hand_side(t, x, inputs(t), held);
  a = switches()*dx({{n}} + 1:end);
end

function held = hold_signs(t, x, modes)
  % Signs in the dry friction: 1 or -1 where a joint slides; where it sticks (mode 0), what keeps it at rest.
  held = modes;
  for again = 1:numel(modes)
    for k = find(modes' == 0)
      held(k) = -1; a = gains(t, x, held);
      held(k) = 1; b = gains(t, x, held);
      held(k) = (a(k) + b(k))/(a(k) - b(k));
    end
  end
end

function which = turned(t, x, modes)
  % Joints that slide against their sign, or stick by more than dry friction can hold.
  held = hold_signs(t, x, modes);
  slides = modes ~= 0;
  which = (slides & modes.*(switches()*x({{n}} + 1:end)) < 0) | (~slides & abs(held) > 1);
end

function mode = released(k, t, x, modes)  % how joint k goes on from rest: its sign, or 0 where it sticks
  for mode = [1, -1]
    modes(k) = mode;
    a = gains(t, x, hold_signs(t, x, modes));
    if mode*a(k) > 0, return, end
  end
  mode = 0;
end

function [x, modes] = step(t, x, h, modes)
  % State at t + h; modes change where joints reverse, stick or break loose.
  last = t + h;
  for events = 1:24
    y = runge_kutta(t, x, last - t, modes);
    if ~any(turned(last, y, modes)), break, end
    low = 0; high = last - t;
    for bisection = 1:50
      middle = 0.5*(low + high);
      if any(turned(t + middle, runge_kutta(t, x, middle, modes), modes)), high = middle; else, low = middle; end
    end
    x = runge_kutta(t, x, high, modes);
    t = t + high;
    for k = find(turned(t, x, modes)')
      modes(k) = released(k, t, x, modes);
    end
    y = runge_kutta(t, x, last - t, modes);
  end
  x = y;
end

function y = runge_kutta(t, x, h, modes)  % state at t + h: classical Runge-Kutta method of order 4
  rate = @(t, x) right_hand_side(t, x, inputs(t), hold_signs(t, x, modes));
{{/events}}
  k1 = rate(t, x);
  k2 = rate(t + 0.5*h, x + 0.5*h*k1);
  k3 = rate(t + 0.5*h, x + 0.5*h*k2);
  k4 = rate(t + h, x + h*k3);
  y = x + h/6*(k1 + 2*k2 + 2*k3 + k4);
end
