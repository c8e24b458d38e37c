//! End-to-end tests: the program and the library over the whole line, one file a subject.

mod accuracy;
mod bad_input;
mod batch;
mod coupled;
mod demo;
mod determinism;
mod device;
#[cfg(unix)]
mod documented;
mod excited;
mod explained;
mod exported;
mod faulty_link;
mod free_decay;
mod hostile;
mod interface;
mod interrupted;
mod isolator;
mod json_page;
#[cfg(target_os = "linux")]
mod live;
mod measured;
mod measured_base;
mod measured_inputs;
mod memory;
mod outputs;
mod own_as_built_in;
mod own_file;
mod own_systems;
mod pages;
mod planned;
mod program;
mod quarter_car;
mod reduced;
mod schema;
mod shaft;
mod stick_slip;
mod suspects_equations;
mod suspects_record;
mod tracked;
mod unnamed;
mod unplugged;
mod validated;
mod verdicts;
mod windows;
mod yielding_frame;
