// double pendulum on a shaker: equations of motion, identified (method: explain).
// Written by `whirl export`, version 0.1.0.
//
// State x: phi1 (rad), phi2 (rad), v_phi1 (rad/s), v_phi2 (rad/s).
// Drive: 5 Hz, phase tau = OMEGA t.
// Effects beside the nominal model:
//   quadratic-drag@arm2: −k ω |ω|; value 2e-7 N m s², standard error 5.0e-10
//   viscous-friction@joint1: −c v; value 2e-6 N m s, standard error 1.0e-7
//   cogging@joint1: −A sin(n x + ψ); value 9e-5 N m, standard error 1.0e-6, n = 7, psi = -0.9454
//   zero-offset@encoder2: θ + b; value 0.01 rad, standard error 2.0e-5 (changes what the sensor shows, not the
//     motion: it is not in the equations)
//
// The equations as they were identified; the tool solves them for the accelerations. Simulate it as it is for an example.
// Dry friction: sign(v) is 0 at v = 0 only. Where joints stick, tools creep or stop; friction elements of the standard library do not.
model double_pendulum "double pendulum on a shaker"
  function wrap "Angle in [-pi, pi), rad"
    input Real x;
    output Real y;
  algorithm
    y := x - 6.283185307179586*floor(x/6.283185307179586 + 0.5);
  end wrap;
  parameter Real OMEGA = 31.41592653589793 "rad/s; angular frequency of the drive";
  parameter Real B11 = 0.11316 "no unit; standard error 2.1e-5";
  parameter Real B12 = 0.07071 "no unit; standard error 1.1e-5";
  parameter Real B13 = -0.11047 "no unit; standard error 3.1e-5";
  parameter Real B14 = 1.2e-5 "no unit; standard error 2.9e-5";
  parameter Real C11 = 0.00102 "no unit; standard error 4.0e-6";
  parameter Real C12 = 0.003266 "no unit; standard error 5.0e-6";
  parameter Real B21 = 1.6816 "no unit; standard error 4.0e-4";
  parameter Real B22 = 0.26325 "no unit; standard error 2.2e-5";
  parameter Real B23 = -0.41126 "no unit; standard error 4.1e-5";
  parameter Real B24 = 8e-6 "no unit; standard error 3.8e-5";
  parameter Real C2 = 0.0485 "no unit; standard error 1.1e-5";
  parameter Real quadratic_drag_arm2 = 0.00496 "strength of quadratic-drag@arm2 (2e-7 N m s²), as it enters the equations";
  parameter Real viscous_friction_joint1 = 0.0496 "strength of viscous-friction@joint1 (2e-6 N m s), as it enters the equations";
  parameter Real cogging_joint1_C = 1.3 "strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations";
  parameter Real cogging_joint1_S = -1.8 "strength of cogging@joint1 (of the effect as a whole: 9e-5 N m), as it enters the equations";
  Real phi1(start = 1.0, fixed = true) "rad";
  Real v_phi1(start = 0.0, fixed = true) "rad/s";
  Real phi1_tau "d phi1/d tau";
  Real phi1_tau_tau "d2 phi1/d tau2";
  Real phi2(start = 1.0, fixed = true) "rad";
  Real v_phi2(start = 0.0, fixed = true) "rad/s";
  Real phi2_tau "d phi2/d tau";
  Real phi2_tau_tau "d2 phi2/d tau2";
  Real tau "rad; phase of the drive";
equation
  der(phi1) = v_phi1;
  der(phi2) = v_phi2;
  tau = OMEGA*time;
  phi1_tau = v_phi1/OMEGA;
  phi1_tau_tau = der(v_phi1)/OMEGA^2;
  phi2_tau = v_phi2/OMEGA;
  phi2_tau_tau = der(v_phi2)/OMEGA^2;
  B11*(phi2_tau_tau*cos(phi2 - phi1) - phi2_tau^2*sin(phi2 - phi1))
    + B12*sin(phi1)
    + B13*sin(phi1)*cos(tau)
    + B14*sin(phi1)*sin(tau)
    + C11*sign(phi1_tau)
    + C12*(phi1_tau - phi2_tau)
    + viscous_friction_joint1*6.818211905903273e-5*v_phi1
    + cogging_joint1_C*6.818211905903273e-5*sin(7.0*wrap(phi1))
    + cogging_joint1_S*6.818211905903273e-5*cos(7.0*wrap(phi1)) = -phi1_tau_tau;
  B21*(phi1_tau_tau*cos(phi2 - phi1) + phi1_tau^2*sin(phi2 - phi1))
    + B22*sin(phi2)
    + B23*sin(phi2)*cos(tau)
    + B24*sin(phi2)*sin(tau)
    + C2*(phi2_tau - phi1_tau)
    + quadratic_drag_arm2*0.0010132118364233778*v_phi2*abs(v_phi2) = -phi2_tau_tau;
  annotation(experiment(StopTime = 1.0, Tolerance = 1e-10));
end double_pendulum;
