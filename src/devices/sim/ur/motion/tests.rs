//! The arm alone.

use super::*;

fn flawless(seed: u64) -> Motion {
    let config = SimUrConfig { flaws: Flaws::none(), ..SimUrConfig::default() };
    Motion::new(&config, &Individual::draw(&config, seed), seed)
}

#[test]
fn a_joint_move_keeps_its_speed_and_acceleration() {
    let mut motion = flawless(1);
    let from = motion.target();
    motion.start_joint_move(std::array::from_fn(|i| from[i] + 0.1 * i as f64), 0.4, 0.8);
    let (mut time_s, mut before, mut fastest) = (0.0, 0.0, 0.0_f64);
    while motion.is_busy() {
        motion.tick(1.0).unwrap();
        let speed = motion.target_speed()[5];
        assert!((speed - before).abs() <= 0.8 * TICK_S + 0.4e-2, "{speed} after {before}");
        (before, fastest, time_s) = (speed, fastest.max(speed), time_s + TICK_S);
    }
    // 0.5 rad at 0.4 rad/s and 0.8 rad/s2: ramps of 0.5 s and 0.1 rad each, 0.3 rad in 0.75 s.
    assert!((time_s - 1.75).abs() < 3.0 * TICK_S, "{time_s}");
    assert!((fastest - 0.4).abs() < 1e-9, "{fastest}");
    assert!((motion.target()[5] - from[5] - 0.5).abs() < 1e-12);
}

#[test]
fn short_moves_are_triangles() {
    let profile = Trapezoid::new(0.1, 10.0, 1.0);
    assert!((profile.duration_s() - 2.0 * 0.1_f64.sqrt()).abs() < 1e-12);
    assert!((profile.at(profile.duration_s() / 2.0) - 0.5).abs() < 1e-12);
    assert!((profile.at(profile.duration_s()) - 1.0).abs() < 1e-12);
}

#[test]
fn a_stop_slows_the_leading_joint_as_asked_and_stays_on_the_path() {
    let mut motion = flawless(2);
    let from = motion.target();
    motion.start_joint_move(from.map(|q| q + 2.0), 1.0, 10.0);
    (0..250).for_each(|_| motion.tick(1.0).unwrap());
    motion.stop(5.0);
    let mut ticks = 0;
    while motion.is_busy() {
        motion.tick(1.0).unwrap();
        ticks += 1;
    }
    assert!((f64::from(ticks) * TICK_S - 0.2).abs() < 0.005, "{ticks} ticks");
    let moved = motion.target()[0] - from[0];
    assert!((motion.target()[3] - from[3] - moved).abs() < 1e-12 && moved < 0.6);
}

#[test]
fn ringing_has_the_size_asked_for_and_dies() {
    let config = SimUrConfig::default();
    let mut motion = Motion::new(&config, &Individual::draw(&config, 3), 3);
    let to = std::array::from_fn(|i| motion.target()[i] + 0.2);
    motion.start_joint_move(to, 1.0, 3.0);
    while motion.is_busy() {
        motion.tick(1.0).unwrap();
    }
    assert!(!motion.is_steady());
    let rest = motion.arm().forward(&motion.target());
    let mut largest_m = 0.0_f64;
    let mut ticks = 0;
    while !motion.is_steady() {
        motion.tick(1.0).unwrap();
        largest_m = largest_m.max(rest.distance_to_m(&motion.arm().forward(&motion.encoded())));
        ticks += 1;
    }
    assert!((0.04e-3..0.5e-3).contains(&largest_m), "{largest_m}");
    assert!((20..600).contains(&ticks), "{ticks}");
}

#[test]
fn a_line_out_of_reach_is_a_fault() {
    let mut motion = flawless(4);
    let stretched = [0.0, -1.57, 0.0, 0.0, 1.57, 0.0];
    let mut other = stretched;
    other[0] = 3.0;
    motion.target = stretched;
    // Through the axis of the base: the first joint would have to jump.
    motion.start_line(&other, 0.25, 0.5);
    let fault = (0..5000).find_map(|_| motion.tick(1.0).err());
    assert!(fault.is_some());
}
