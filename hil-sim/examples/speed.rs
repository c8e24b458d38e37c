//! Time of a simulated record: 22 minutes of the chaotic rig at 500 Hz, 670 000 samples, straight
//! from the plant and through the firmware in lock-step.
//!
//! `cargo run --release -p whirl-hil-sim --example speed`

use std::time::Instant;

use whirl_hil_sim::{RigSettings, Simulation, SimulationError, SimulationSettings, VirtualRig};

fn main() -> Result<(), SimulationError> {
    let mut simulation = Simulation::new(&SimulationSettings::default())?;
    let start = Instant::now();
    let mut sum = 0_i64;
    for _ in 0..670_000 {
        sum = sum.wrapping_mul(31).wrapping_add(i64::from(simulation.next_sample()?.counts[1]));
    }
    println!("670000 samples in {:.2} s (check {sum:x})", start.elapsed().as_secs_f64());
    let mut rig = VirtualRig::new(&RigSettings::default())?;
    let start = Instant::now();
    let mut bytes = 0;
    for _ in 0..670_000 {
        rig.step()?;
        bytes += rig.take_output().len();
    }
    println!("670000 ticks of the virtual rig, free, in {:.2} s ({bytes} bytes)", start.elapsed().as_secs_f64());
    Ok(())
}
