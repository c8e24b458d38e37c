use super::*;

#[test]
fn rates_are_those_of_which_a_tick_is_whole_points_and_microseconds() {
    for (rate, points) in [
        (250_000, 160),
        (320_000, 125),
        (400_000, 100),
        (500_000, 80),
        (625_000, 64),
        (800_000, 50),
        (1_000_000, 40),
        (1_600_000, 25),
        (2_000_000, 20),
    ] {
        let schedule = schedule(rate).unwrap();
        assert_eq!(schedule.points, points);
        let clocks = (u32::from(schedule.prescaler) + 1) * schedule.period();
        assert_eq!((clocks, microseconds(&schedule)), (points as u32 * 3_750, points as u32 * 25));
        assert_eq!(u64::from(microseconds(&schedule)) * u64::from(rate), 1_000_000_000);
        assert!(schedule.period() / points as u32 >= 375);
    }
    for rate in [0, 100_000, 200_000, 333_333, 300_000, 4_000_000, u32::MAX] {
        assert_eq!(schedule(rate), None, "{rate}");
    }
}
