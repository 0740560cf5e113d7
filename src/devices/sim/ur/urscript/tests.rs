//! The language, on an arm without flaws, in simulated time.

mod functions;
mod limits;
mod threads;

use std::cell::RefCell;
use std::rc::Rc;

use super::{Program, Slice};
use crate::devices::sim::ur::body::{Body, Runtime};
use crate::devices::sim::ur::config::{Flaws, Individual, SimUrConfig};

fn body() -> Rc<RefCell<Body>> {
    let config = SimUrConfig { flaws: Flaws::none(), ..SimUrConfig::default() };
    Rc::new(RefCell::new(Body::new(&config, &Individual::draw(&config, 1), 1)))
}

/// Runs to the end, at most 10 s, and gives the slices used and the end.
fn run(text: &str, body: &Rc<RefCell<Body>>) -> (usize, Slice) {
    let mut program = match Program::new(text, body.clone()) {
        Ok(program) => program,
        Err(why) => return (0, Slice::Failed(why)),
    };
    for slice in 0..5000 {
        match program.resume() {
            Slice::Running => body.borrow_mut().tick_drives(),
            end => return (slice, end),
        }
    }
    (5000, Slice::Running)
}

fn register_0(body: &Rc<RefCell<Body>>, text: &str) -> f64 {
    let (_, end) = run(text, body);
    assert_eq!(end, Slice::Ended, "{text}");
    body.borrow().output_double[0]
}

#[test]
fn the_language() {
    for (statements, known) in [
        ("x = 1 + 2 * 3 - 4 / 8 write_output_float_register(0, x)", 6.5),
        ("a = [1, 2, 3]\n a[1] = 5 write_output_float_register(0, a[1] % 3)", 2.0),
        ("def f(a, b):\n return a - b\n end\n write_output_float_register(0, f(b=2, a=9))", 7.0),
        ("global x =\n 4\n y = -x\n write_output_float_register(0, y)", -4.0),
        ("i = 0 while (i < 10): i = i + 1 if i == 7: break end end write_output_float_register(0, i)", 7.0),
        ("p1 = p[1, 2, 2, 0, 0, 0] write_output_float_register(0, norm(p1))", 3.0),
        (
            "x = 3\n if x > 5:\n y = 1\n elif not x == 3:\n y = 2\n else:\n y = 3\n end\n write_output_float_register(0, y)",
            3.0,
        ),
        ("x = False and undefined or True # comment \"\n if x: write_output_float_register(0, 1.5e-1) end", 0.15),
        ("def f():\n x = 5\n end\n x = 1\n f()\n write_output_float_register(0, x)", 5.0),
        ("def f():\n local x = 5\n end\n x = 1\n f()\n write_output_float_register(0, x)", 1.0),
        (
            "def f(n):\n if n < 2: return 1 end\n return n * f(n - 1)\n end\n write_output_float_register(0, f(5))",
            120.0,
        ),
        // Two lines, and two statements on one.
        ("global x =\n\n 4 global y =\n 2\n write_output_float_register(0, x * y) z = 1", 8.0),
        ("def f():\n global g = 3\n end\n f() write_output_float_register(0, g)", 3.0),
        // A parameter may be called as the mark of a pose.
        (
            "def f(p):\n p[0] = p[0] * 2\n return p\n end\n q = f(p[4, 0, 0, 0, 0, 0])\n write_output_float_register(0, q[0])",
            8.0,
        ),
        (
            "s = struct(a=1, b=[5, 6])\n s.a = s.a + s.b[1]\n s.b[0] = 7\n write_output_float_register(0, s.a + s.b[0])",
            14.0,
        ),
        ("m = [[1, 2], [3, 4]]\n m[1][0] = 9\n write_output_float_register(0, m[1, 0] + m[0, 1])", 11.0),
        ("def f():\n if True: return end\n return 1\n end\n f() write_output_float_register(0, 6)", 6.0),
        // Never called, never missed.
        ("def f():\n moon_landing(direct_torque(q=1))\n end\n write_output_float_register(0, 1)", 1.0),
        (
            "i = 0\n while True:\n i = i + 1\n if i < 5: continue end\n break\n end\n write_output_float_register(0, i)",
            5.0,
        ),
    ] {
        assert_eq!(register_0(&body(), &format!("def prog():\n{statements}\nend\n")), known, "{statements}");
    }
}

#[test]
fn time_passes_only_where_it_should() {
    let body = body();
    assert_eq!(run("def p():\n sync()\n sleep(0.1)\n sync()\nend\n", &body), (52, Slice::Ended));
    assert_eq!(run("textmsg(\"one line\")\n", &body), (0, Slice::Ended));
}

#[test]
fn faults_say_what_and_where() {
    for (text, why) in [
        ("def p():\n\n nonsense(1)\nend", "line 3: function `nonsense` is not known"),
        ("def p():\n x = y\nend", "line 2: `y` is not defined"),
        ("def p():\n while True:\n end\nend", "line 2: infinite loop: the program takes no time"),
        ("def f():\n f()\nend\nf()", "calls nested too deep"),
        ("def p():\n if True:\nend", "expected `end`"),
        ("def p():\n x = [1][3]\nend", "line 2: index 3 is out of range"),
        ("def p():\n movej([0, 0, 0], 1, 1)\nend", "3 numbers where six are needed"),
        ("def p():\n movej([0, 0, 0, 0, 0, 99], 1, 1)\nend", "outside"),
        ("x = 1 $ 2", "`$` begins no word"),
        ("def p():\n force_mode(1)\nend", "line 2: function `force_mode` is not simulated"),
        ("def p():\n f = run nothing()\nend", "line 2: thread `nothing` is not known"),
        ("def p():\n s = struct(a=1)\n x = s.b\nend", "line 3: the struct has no `b`"),
        ("struct(1)", "named members"),
        ("def p():\n norm(1, 2)\nend", "are taken, not these"),
        ("set_payload(900)", "900 kg is not from 0"),
        ("set_digital_out(18, True)", "there is no number 18"),
        ("write_output_integer_register(48, 1)", "there is no number 48"),
        ("x = acos(2)", "`acos` has no value there"),
    ] {
        let (_, end) = run(text, &body());
        assert!(matches!(&end, Slice::Failed(found) if found.contains(why)), "{text}: {end:?}, not {why}");
    }
    let brackets = format!("x = {}1{}", "(".repeat(5000), ")".repeat(5000));
    for deep in [brackets, format!("x = 1{}", "+1".repeat(200_000)), "if True: ".repeat(5000), "-".repeat(5000)] {
        assert!(matches!(run(&deep, &body()).1, Slice::Failed(_)));
    }
}

#[test]
fn moves_block_until_the_arm_is_there() {
    let body = body();
    let text = "def p():\n q = get_actual_joint_positions()\n q[0] = q[0] + 0.5\n movej(q, a=2.0, v=1.0)\n\
                t = get_actual_tcp_pose()\n t[2] = t[2] + 0.1\n movel(t, 0.5, 0.25)\nend\n";
    let before = body.borrow().motion.target();
    let (slices, end) = run(text, &body);
    assert_eq!(end, Slice::Ended);
    // 1 s for 0.5 rad, 0.9 s for 0.1 m.
    assert!((900..960).contains(&slices), "{slices}");
    let after = body.borrow().motion.target();
    assert!((after[0] - before[0] - 0.5).abs() < 1e-6);
}

#[test]
fn the_executor_script_is_understood() {
    let body = body();
    body.borrow_mut().runtime = Runtime::Playing;
    let mut program = Program::new(crate::devices::ur::MOTION_SCRIPT, body.clone()).unwrap();
    for _ in 0..20 {
        assert_eq!(program.resume(), Slice::Running);
    }
    assert_eq!(body.borrow().output_int[25], 1);
}
