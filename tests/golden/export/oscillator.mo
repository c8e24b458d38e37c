// Duffing's oscillator, "stiff": equations of motion, identified (method: shooting).
// Written by `whirl export`, version 0.1.0.
//
// State x: x (SI unit), v_x (SI unit/s).
// Inputs u: force (SI unit).
// Effects beside the nominal model:
//   cubic-stiffness@x: −k x³; value 1.5 N/m³, standard error 2.0e-1
//
// The equations as they were identified; the tool solves them for the accelerations. Simulate it as it is for an example.
model oscillator "Duffing's oscillator, \"stiff\""
  parameter Real m = 1.0002 "kg; standard error 1.1e-5";
  parameter Real c = 0.3999 "N s/m; standard error 2.2e-4";
  parameter Real k = 40.01 "N/m; standard error 1.2e-3";
  parameter Real k3 = 59.98 "N/m³; standard error 6.5e-3";
  parameter Real F_v = 0.21 "N; standard error not known";
  parameter Real cubic_stiffness_x = 1.5 "strength of cubic-stiffness@x, as it enters the equations";
  Real x(start = 0.1, fixed = true) "SI unit";
  Real v_x(start = 0.0, fixed = true) "SI unit/s";
  Real force = 0.0 "SI unit; input, change it to your needs";
equation
  der(x) = v_x;
  m*der(v_x)
    + c*v_x
    + k*x
    + k3*x^3
    + F_v*tanh(2.0*v_x)*exp(-x^2)/(1.0 + abs(x))
    + cubic_stiffness_x*x^3 = force;
  annotation(experiment(StopTime = 1.0, Tolerance = 1e-10));
end oscillator;
