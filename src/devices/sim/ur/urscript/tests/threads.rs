//! Threads, critical sections, secondary programs.

use super::*;

/// The output registers 0 to 2 of a program that ends, and how many cycles it took.
fn registers(text: &str) -> ([i32; 3], usize) {
    let body = body();
    let (slices, end) = run(text, &body);
    assert_eq!(end, Slice::Ended, "{text}");
    let found = body.borrow().output_int;
    ([found[0], found[1], found[2]], slices)
}

#[test]
fn threads_share_globals_and_end_with_the_program() {
    let (found, slices) = registers(
        "def p():
           global count = 0
           thread counting():
             while True:
               count = count + 1
               write_output_integer_register(1, count)
               sync()
             end
           end
           t = run counting()
           sleep(0.02)
           write_output_integer_register(0, count)
         end",
    );
    // Started in the first cycle, after the program's own turn; dead in the eleventh.
    assert_eq!((found, slices), ([10, 10, 0], 10));
}

#[test]
fn a_thread_is_joined_or_killed() {
    let text = |last: &str| {
        format!(
            "def p():
               thread worker(by):
                 sleep(0.01)
                 write_output_integer_register(0, by)
               end
               t = run worker(by=7)
               {last}
               write_output_integer_register(1, 1)
               if t != 0: sleep(0.05) end
             end"
        )
    };
    assert_eq!(
        registers(&text("join t write_output_integer_register(2, read_output_integer_register(0))")).0,
        [7, 1, 7]
    );
    assert_eq!(registers(&text("sync() kill t kill t kill 0 join t t = 0")).0, [0, 1, 0]);
    assert_eq!(registers("thread f():\n kill 0\nend\n t = run f() kill t sync()").0, [0; 3]);
    let own = "def p():\n global t = 0\n thread f():\n kill t write_output_integer_register(0, 1)\n end\n t = run f()\n\
               sleep(0.01)\nend";
    assert_eq!(registers(own).0, [0; 3], "a thread that kills itself goes no further");
}

#[test]
fn a_critical_section_is_nobody_elses_time() {
    let (found, _) = registers(
        "def p():
           global seen = 0
           global inside = False
           thread looker():
             while True:
               if inside: seen = seen + 1 end
               sync()
             end
           end
           t = run looker()
           sync()
           enter_critical
           inside = True
           sleep(0.02)
           inside = False
           exit_critical
           sleep(0.02)
           write_output_integer_register(0, seen)
           enter_critical kill t exit_critical
         end",
    );
    assert_eq!(found[0], 0);
    // Whoever dies inside leaves it.
    let killed = "def p():\n thread f():\n enter_critical sleep(0.01) return 1\n end\n t = run f() sync() sync()\n\
                  write_output_integer_register(0, 1)\nend";
    assert_eq!(registers(killed).0[0], 1);
}

#[test]
fn the_arm_obeys_one_thread_and_brakes_when_that_is_killed() {
    let body = body();
    let both = "def p():\n q = get_target_joint_positions()\n q[0] = q[0] + 1\n thread f(q):\n movej(q)\n end\n\
                t = run f(q)\n sync()\n movej(q)\nend";
    let (_, end) = run(both, &body);
    let known = "line 9: another thread is already controlling the robot";
    assert_eq!(end, Slice::Failed(known.into()));

    let body = super::body();
    let start = body.borrow().motion.target();
    let killed = "def p():\n global q = get_target_joint_positions()\n q[0] = q[0] + 1\n thread f():\n movej(q, a=2, v=1)\n\
                  end\n t = run f()\n sleep(0.6)\n kill t\n stopj(4)\n write_output_float_register(0, 1)\n\
                  movej(q, a=2, v=1)\nend";
    let (slices, end) = run(killed, &body);
    assert_eq!(end, Slice::Ended);
    // 0.35 rad on the way, 0.25 s to a stop, and the rest of 1 rad.
    assert!((850..1000).contains(&slices), "{slices}");
    assert!((body.borrow().motion.target()[0] - start[0] - 1.0).abs() < 1e-9);
}

#[test]
fn every_thread_has_its_turn_when_others_go() {
    let (found, _) = registers(
        "def p():
           global a = 0
           global b = 0
           global t = 0
           thread first():
             sleep(1)
           end
           thread second():
             sync()
             kill t
           end
           thread third():
             while True:
               b = b + 1
               sync()
             end
           end
           t = run first()
           u = run second()
           v = run third()
           while a < 5:
             a = a + 1
             sync()
           end
           write_output_integer_register(0, b)
         end",
    );
    assert_eq!(found[0], 5, "one turn a cycle");
}

#[test]
fn a_secondary_program_is_over_at_once() {
    let run = |text: &str| {
        let body = body();
        let mut program = Program::new(text, body.clone()).unwrap();
        assert!(program.is_secondary());
        let end = program.run_at_once();
        (end, body.borrow().digital_outputs, body.borrow().motion.is_busy())
    };
    assert_eq!(run("sec s():\n set_digital_out(2, True)\nend\n"), (Ok(()), 4, false));
    let (end, _, _) = run("sec s():\n sleep(1)\nend\n");
    assert!(end.unwrap_err().contains("must not take time"));
    let (end, _, moves) = run("sec s():\n movej([0, -1, -1, 0, 0, 0])\nend\n");
    assert!(end.unwrap_err().contains("must not move") && !moves);
    assert!(Program::new("sec s():\nend\nx = 1", body()).is_err());
}

#[test]
fn speeds_and_servos() {
    let run_for = |text: &str, slices: usize| {
        let body = body();
        let before = body.borrow().motion.target();
        let mut program = Program::new(text, body.clone()).unwrap();
        for _ in 0..slices {
            if program.resume() != Slice::Running {
                break;
            }
            body.borrow_mut().tick_drives();
        }
        let after = body.borrow().motion.target();
        let moved: [f64; 6] = std::array::from_fn(|i| after[i] - before[i]);
        (moved, body)
    };
    // 0.5 s to the speed, 0.5 s at it, 0.25 s to rest.
    let (moved, body) = run_for("speedj([0, 0, 0, 0, 0, 1], 2)\nsleep(0.5)\nstopj(4)\nsleep(9)", 800);
    assert!((moved[5] - 0.875).abs() < 5e-3 && moved[0] == 0.0, "{moved:?}");
    assert!(!body.borrow().motion.is_busy());

    let (_, body) = run_for("speedl([0, 0.1, 0, 0, 0, 0], 0.5, 0.3)\nsleep(9)", 200);
    let (target, speed) = (body.borrow().motion.target(), body.borrow().motion.target_speed());
    let tcp = body.borrow().motion.tcp_speed(&target, &speed);
    assert!((tcp[1] - 0.1).abs() < 1e-4 && tcp[0].abs() < 1e-4 && tcp[5].abs() < 1e-4, "{tcp:?}");

    let servo = "q = get_target_joint_positions()\nq[3] = q[3] + 0.1\ni = 0\nwhile i < 400:\n servoj(q, t=0.002)\n i = i + 1\n\
                 end\nsleep(1)";
    let (moved, body) = run_for(servo, 1000);
    assert!((moved[3] - 0.1).abs() < 1e-4, "{moved:?}");
    assert!(!body.borrow().motion.is_busy());

    let (moved, body) = run_for("speedj([0, 0, 9, 0, 0, 0], 10)\nsleep(9)", 2000);
    assert_ne!(body.borrow().safety, crate::devices::sim::ur::body::Safety::Normal, "too fast: {moved:?}");
}

#[test]
fn a_timed_move_takes_its_time() {
    let text = "q = get_target_joint_positions()\nq[0] = q[0] + 0.3\nmovej(q, t=0.8)\n\
                p1 = get_target_tcp_pose()\np1[2] = p1[2] + 0.05\nmovel(p1, t=0.6)";
    let (slices, end) = run(text, &body());
    assert_eq!(end, Slice::Ended);
    assert!((slices as f64 * 0.002 - 1.4).abs() < 0.01, "{slices}");
}
