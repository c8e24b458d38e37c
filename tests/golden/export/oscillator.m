function [t, x, f] = oscillator(seconds, step_s, x)
% Duffing's oscillator, "stiff": equations of motion, identified (method: shooting).
% Written by `whirl export`, version 0.1.0.
%
% State x: x_ (SI unit), v_x (SI unit/s).
% Inputs u: force (SI unit).
% Effects beside the nominal model:
%   cubic-stiffness@x: −k x³; value 1.5 N/m³, standard error 2.0e-1
%
% [t, x, f] = oscillator integrates the example below and returns times t (s), states x (one row each) and
% the right-hand side f(t, x, u); oscillator(seconds, step_s, x0) takes another length, step and initial state.

  if nargin < 1, seconds = 1; end
  if nargin < 2, step_s = 1e-4; end
  if nargin < 3, x = [0.1; 0.0]; end  % x_, v_x
  f = @right_hand_side;
  count = round(seconds/step_s) + 1;
  t = (0:count - 1)'*step_s;
  states = zeros(count, numel(x));
  x = x(:);
  for i = 1:count
    states(i, :) = x';
    x = runge_kutta(t(i), x, step_s);
  end
  x = states;
end

function u = inputs(t)  % inputs at time t: change them to your needs
  u = [0];
end

function dx = right_hand_side(t, x, u)
  % dx/dt at time t (s) for the state x = [x_, v_x] and inputs u = [force].
  m = 1.0002;  % kg; standard error 1.1e-5
  c = 0.3999;  % N s/m; standard error 2.2e-4
  k = 40.01;  % N/m; standard error 1.2e-3
  k3 = 59.98;  % N/m³; standard error 6.5e-3
  F_v = 0.21;  % N; standard error not known
  cubic_stiffness_x = 1.5;  % strength of cubic-stiffness@x, as it enters the equations

  x_ = x(1);  % SI unit
  v_x = x(2);  % SI unit/s
  force = u(1);  % SI unit
  % Each equation of the model, solved for its accelerations: matrix * acceleration = right.
  matrix = zeros(1);
  right = zeros(1, 1);
  matrix(1, 1) = m;
  right(1) = -c*v_x ...
      - k*x_ ...
      - k3*x_^3 ...
      - F_v*tanh(2.0*v_x)*exp(-x_^2)/(1.0 + abs(x_)) ...
      + force ...
      - cubic_stiffness_x*x_^3;
  acceleration = matrix\right;
  dx = [v_x; acceleration(1)];
end

function y = runge_kutta(t, x, h)  % state at t + h: classical Runge-Kutta method of order 4
  rate = @(t, x) right_hand_side(t, x, inputs(t));
  k1 = rate(t, x);
  k2 = rate(t + 0.5*h, x + 0.5*h*k1);
  k3 = rate(t + 0.5*h, x + 0.5*h*k2);
  k4 = rate(t + h, x + h*k3);
  y = x + h/6*(k1 + 2*k2 + 2*k3 + k4);
end
