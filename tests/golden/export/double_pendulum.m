function [t, x, f] = double_pendulum(seconds, step_s, x)
% double pendulum on a shaker: equations of motion, identified (method: explain).
% Written by `whirl export`, version 0.1.0.
%
% State x: phi1 (rad), phi2 (rad), v_phi1 (rad/s), v_phi2 (rad/s).
% Drive: 5 Hz, phase tau = OMEGA t.
% Effects beside the nominal model:
%   quadratic-drag@arm2: −k ω |ω|; value 2e-7 N m s², standard error 5.0e-10
%   viscous-friction@joint1: −c v; value 2e-6 N m s, standard error 1.0e-7
%   cogging@joint1: −A sin(n x + ψ); value 9e-5 N m, standard error 1.0e-6, n = 7, psi = -0.9454
%   zero-offset@encoder2: θ + b; value 0.01 rad, standard error 2.0e-5 (changes what the sensor shows, not the
%     motion: it is not in the equations)
%
% [t, x, f] = double_pendulum integrates the example below and returns times t (s), states x (one row each) and
% the right-hand side f(t, x, u); double_pendulum(seconds, step_s, x0) takes another length, step and initial state.

  if nargin < 1, seconds = 1; end
  if nargin < 2, step_s = 1e-4; end
  if nargin < 3, x = [1.0; 1.0; 0.0; 0.0]; end  % phi1, phi2, v_phi1, v_phi2
  f = @right_hand_side;
  count = round(seconds/step_s) + 1;
  t = (0:count - 1)'*step_s;
  states = zeros(count, numel(x));
  x = x(:);
  weights = switches();
  modes = sign(weights*x(2 + 1:end));
  for k = find(modes' == 0)
    modes(k) = released(k, 0, x, modes);
  end
  for i = 1:count
    states(i, :) = x';
    [x, modes] = step(t(i), x, step_s, modes);
  end
  x = states;
end

function u = inputs(t)  % inputs at time t: change them to your needs
  u = [];
end

function dx = right_hand_side(t, x, u, held)
  % held: signs in the dry friction, where an integrator holds them; otherwise those of the rates.
  if nargin < 4, held = sign(switches()*x(2 + 1:end)); end
  % dx/dt at time t (s) for the state x = [phi1, phi2, v_phi1, v_phi2] and inputs u = [].
  OMEGA = 31.41592653589793;  % rad/s; angular frequency of the drive
  B11 = 0.11316;  % no unit; standard error 2.1e-5
  B12 = 0.07071;  % no unit; standard error 1.1e-5
  B13 = -0.11047;  % no unit; standard error 3.1e-5
  B14 = 1.2e-5;  % no unit; standard error 2.9e-5
  C11 = 0.00102;  % no unit; standard error 4.0e-6
  C12 = 0.003266;  % no unit; standard error 5.0e-6
  B21 = 1.6816;  % no unit; standard error 4.0e-4
  B22 = 0.26325;  % no unit; standard error 2.2e-5
  B23 = -0.41126;  % no unit; standard error 4.1e-5
  B24 = 8e-6;  % no unit; standard error 3.8e-5
  C2 = 0.0485;  % no unit; standard error 1.1e-5
  quadratic_drag_arm2 = 0.00496;  % strength of quadratic-drag@arm2 (2e-7 N m s²), as it enters the equations
  viscous_friction_joint1 = 0.0496;  % strength of viscous-friction@joint1 (2e-6 N m s), as it enters the equations
  cogging_joint1_C = 1.3;  % strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations
  cogging_joint1_S = -1.8;  % strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations

  phi1 = x(1);  % rad
  phi2 = x(2);  % rad
  v_phi1 = x(3);  % rad/s
  v_phi2 = x(4);  % rad/s
  tau = OMEGA*t;  % rad; phase of the drive
  phi1_tau = v_phi1/OMEGA;  % d phi1/d tau
  phi2_tau = v_phi2/OMEGA;  % d phi2/d tau
  s1 = held(1);  % sign in the dry friction
  % Each equation of the model, solved for its accelerations: matrix * acceleration = right.
  matrix = zeros(2);
  right = zeros(2, 1);
  matrix(1, 1) = 1.0;
  matrix(1, 2) = B11*cos(phi2 - phi1);
  matrix(2, 1) = B21*cos(phi2 - phi1);
  matrix(2, 2) = 1.0;
  right(1) = B11*phi2_tau^2*sin(phi2 - phi1) ...
      - B12*sin(phi1) ...
      - B13*sin(phi1)*cos(tau) ...
      - B14*sin(phi1)*sin(tau) ...
      - C11*s1 ...
      - C12*(phi1_tau - phi2_tau) ...
      - viscous_friction_joint1*6.818211905903273e-5*v_phi1 ...
      - cogging_joint1_C*6.818211905903273e-5*sin(7.0*wrap(phi1)) ...
      - cogging_joint1_S*6.818211905903273e-5*cos(7.0*wrap(phi1));
  right(2) = -B21*phi1_tau^2*sin(phi2 - phi1) ...
      - B22*sin(phi2) ...
      - B23*sin(phi2)*cos(tau) ...
      - B24*sin(phi2)*sin(tau) ...
      - C2*(phi2_tau - phi1_tau) ...
      - quadratic_drag_arm2*0.0010132118364233778*v_phi2*abs(v_phi2);
  acceleration = matrix\right;
  dx = [v_phi1; v_phi2; OMEGA^2*acceleration(1); OMEGA^2*acceleration(2)];
end

function y = wrap(x)  % angle x in [-pi, pi), rad
  y = x - 2*pi*floor(x/(2*pi) + 0.5);
end

% Dry friction jumps where a joint reverses: its sign is held during a step, a step ends where it would turn.

function weights = switches()  % weights of the rates: the joints' relative velocities
  weights = [1.0, 0.0];
end

function a = gains(t, x, held)  % accelerations of the joints with these signs
  dx = right_hand_side(t, x, inputs(t), held);
  a = switches()*dx(2 + 1:end);
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
  which = (slides & modes.*(switches()*x(2 + 1:end)) < 0) | (~slides & abs(held) > 1);
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
  k1 = rate(t, x);
  k2 = rate(t + 0.5*h, x + 0.5*h*k1);
  k3 = rate(t + 0.5*h, x + 0.5*h*k2);
  k4 = rate(t + h, x + h*k3);
  y = x + h/6*(k1 + 2*k2 + 2*k3 + k4);
end
