//! One simulated hour (or as many seconds as are asked for) of three channels (both arms and the
//! base) through every kind of link fault, with back-fill, every sample accounted for.
//! `cargo run --release -p whirl-tests --example accounted_hour [SECONDS] [SEED]`

use whirl_tests::accuracy::measured_base_rig;
use whirl_tests::faulty::capture;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let seconds: f64 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(3600.0);
    let seed: u64 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(1);
    let account = capture(&measured_base_rig(), seconds, seed);
    let l = &account.outcome.losses;
    println!("ticks                {}", account.ticks);
    println!("received             {}", l.received);
    println!("lost on the link     {}", l.lost_on_link);
    println!("damaged              {}", l.damaged);
    println!("overruns, dropped    {}, {}", l.overruns, l.dropped_by_device);
    println!("sum                  {}", l.received + l.lost());
    println!("restored             {} (among the received)", l.restored);
    println!("repeated             {} (not in the sum)", l.duplicates);
    println!("gaps                 {}", l.gaps);
    println!("ticks on which the capture and the fault injector disagree: {}", account.disagreements);
    println!("the injector: {:?} of samples, unplugged {} times", account.injected.samples, account.injected.unplugged);
    if l.received + l.lost() != account.ticks || account.disagreements > 0 {
        std::process::exit(1);
    }
}
