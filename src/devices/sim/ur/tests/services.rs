//! What other clients than our driver rely on: uploaded protocols, streams, the dashboard.

use std::io::{BufRead as _, BufReader};

use super::raw::Raw;
use super::*;
use crate::devices::rtde::{Recipe, Value};

/// Carries out commands that come in input register 2, in a thread where register 3 says so, and answers in
/// output register 2: 1 ready, 2 done; output register 3 is 1 while a thread moves the arm.
const SERVANT: &str = r#"
def servant():
  global move_thread = 0 global target = [0, 0, 0, 0, 0, 0]
  thread mover():
    write_output_integer_register(3, 1)
    movej(target, a=4, v=2)
    enter_critical
    move_thread = 0
    exit_critical
    write_output_integer_register(3, 0)
  end
  def leave():
    enter_critical
    if move_thread != 0:
      kill move_thread
      move_thread =
        0
      write_output_integer_register(3, 0)
    end
    exit_critical
  end
  def do(command):
    textmsg("command ", command)
    if command == 1:
      q = get_target_joint_positions()
      q[0] = q[0] + read_input_float_register(2)
      leave()
      target = q
      if read_input_integer_register(3) == 1: move_thread = run mover() else: movej(q, a=4, v=2) end
    elif command == 2:
      leave() stopj(8)
    elif command == 3:
      write_output_float_register(2, read_input_float_register(2) * 2)
    elif command == 4:
      teleport(1)
    end
    return command != 9
  end
  executing = False
  going_on = True
  while going_on:
    command = read_input_integer_register(2)
    if command == 0:
      executing = False
      write_output_integer_register(2, 1)
    elif not executing:
      executing = True
      going_on = do(command)
      write_output_integer_register(2, 2)
    end
    sync()
  end
end
"#;

const OUTPUTS: [&str; 5] =
    ["output_int_register_2", "output_int_register_3", "output_double_register_2", "runtime_state", "target_q"];

/// A client of the servant: one connection watches and drives time, another one writes commands.
struct Master {
    watch: Raw,
    write: Raw,
    recipe: Recipe,
}

impl Master {
    fn new(sim: &SimController) -> Self {
        let watch = Raw::driving(sim, 500.0, &OUTPUTS);
        let mut write = Raw::agreed(sim);
        let inputs = ["input_int_register_2", "input_int_register_3", "input_double_register_2"];
        let recipe = write.set_up_inputs(&inputs).unwrap();
        Self { watch, write, recipe }
    }

    fn say(&mut self, command: i32, asynchronous: bool, number: f64) {
        let values = [Value::Int32(command), Value::Int32(i32::from(asynchronous)), Value::Double(number)];
        self.write.stream.write_all(&self.recipe.encode(&values).unwrap()).unwrap();
    }

    fn until(&mut self, done: impl Fn(&[Value]) -> bool) -> Vec<Value> {
        self.watch.turn_until(done)
    }

    /// Says it, waits until it is done, and takes it back.
    fn order(&mut self, command: i32, asynchronous: bool, number: f64) -> Vec<Value> {
        self.until(|v| v[0] == Value::Int32(1));
        self.say(command, asynchronous, number);
        let done = self.until(|v| v[0] == Value::Int32(2));
        self.say(0, false, number);
        self.until(|v| v[0] == Value::Int32(1));
        done
    }
}

fn first_joint(values: &[Value]) -> f64 {
    match values[4] {
        Value::Vector6d([q, ..]) => q,
        ref other => panic!("{other:?}"),
    }
}

fn upload(sim: &SimController, port: u16, text: &str) -> TcpStream {
    let mut stream = raw_stream(sim, port);
    stream.write_all(text.as_bytes()).unwrap();
    stream
}

#[test]
fn a_protocol_that_is_uploaded_is_executed() {
    let sim = simulator(SimUrConfig { flaws: Flaws::none(), ..SimUrConfig::default() }, 16);
    let mut master = Master::new(&sim);
    let mut primary = raw_stream(&sim, sim.ports().primary);
    let _script = upload(&sim, sim.ports().realtime, SERVANT);
    let start = first_joint(&master.until(|v| v[3] == Value::Uint32(2)));

    let done = master.order(3, false, 2.25);
    assert_eq!(done[2], Value::Double(4.5));
    let moved = first_joint(&master.order(1, false, 0.3)) - start;
    assert!((moved - 0.3).abs() < 1e-9, "{moved}");

    master.order(1, true, 2.0);
    let before = first_joint(&master.until(|v| v[1] == Value::Int32(1)));
    master.until(|v| first_joint(v) > before + 0.3);
    let stopped = first_joint(&master.order(2, false, 0.0)) - start - 0.3;
    assert!((0.3..1.0).contains(&stopped), "{stopped}");
    master.order(1, true, -0.2);
    let arrived = first_joint(&master.until(|v| v[1] == Value::Int32(0))) - start - 0.3 - stopped;
    assert!((arrived + 0.2).abs() < 1e-9, "{arrived}");

    // What the program says is for the primary interface.
    let mut said = vec![0; 1 << 16];
    let count = primary.read(&mut said).unwrap();
    assert!(String::from_utf8_lossy(&said[..count]).contains("command 3"));

    master.say(9, false, 0.0);
    master.until(|v| v[3] == Value::Uint32(1));
}

#[test]
fn a_fault_in_a_command_ends_the_program() {
    let sim = simulator(SimUrConfig::default(), 17);
    let mut master = Master::new(&sim);
    let _script = upload(&sim, sim.ports().primary, SERVANT);
    master.until(|v| v[0] == Value::Int32(1));
    // Only its call is a fault, not its mention.
    master.say(4, false, 0.0);
    master.until(|v| v[3] == Value::Uint32(1));
}

#[test]
fn a_secondary_program_leaves_the_other_running() {
    let sim = simulator(SimUrConfig::default(), 18);
    let mut watch = Raw::driving(&sim, 500.0, &["runtime_state", "actual_digital_output_bits", "script_control_line"]);
    let _script = upload(&sim, sim.ports().secondary, "def p():\n  while True:\n    sync()\n  end\nend\n");
    watch.turn_until(|v| v[0] == Value::Uint32(2) && v[2] == Value::Uint32(3));
    let _second = upload(&sim, sim.ports().secondary, "sec s():\n  set_digital_out(4, True)\nend\n");
    let seen = watch.turn_until(|v| v[1] == Value::Uint64(16));
    assert_eq!(seen[0], Value::Uint32(2));
    let _third = upload(&sim, sim.ports().secondary, "set_digital_out(5, True)\n");
    let seen = watch.turn_until(|v| v[1] == Value::Uint64(48));
    assert_eq!(watch.turn_until(|v| v[0] == Value::Uint32(1))[1], seen[1], "a line alone replaces the program");
}

#[test]
fn without_lock_step_the_streams_run_by_themselves() {
    let config = SimUrConfig { lock_step_patience: Duration::ZERO, ..SimUrConfig::default() };
    let sim = simulator(config, 19);
    let mut realtime = raw_stream(&sim, sim.ports().realtime);
    let mut package = [0; 1220];
    let mut time_s = |stream: &mut TcpStream| {
        stream.read_exact(&mut package).unwrap();
        assert_eq!(package[..4], 1220_i32.to_be_bytes());
        f64::from_be_bytes(package[4..12].try_into().unwrap())
    };
    let (first, second) = (time_s(&mut realtime), time_s(&mut realtime));
    assert!((second - first - 0.002).abs() < 1e-9, "{first} {second}");
    for port in [sim.ports().primary, sim.ports().secondary] {
        let mut stream = raw_stream(&sim, port);
        let mut kinds = Vec::new();
        for _ in 0..4 {
            let mut size = [0; 4];
            stream.read_exact(&mut size).unwrap();
            let mut rest = vec![0; u32::from_be_bytes(size) as usize - 4];
            stream.read_exact(&mut rest).unwrap();
            kinds.push(rest[0]);
        }
        assert_eq!(kinds, [20, 16, 16, 16]);
    }
}

#[test]
fn the_dashboard_controls_the_program() {
    let sim = simulator(SimUrConfig::default(), 20);
    let mut watch = Raw::driving(&sim, 500.0, &["runtime_state", "robot_mode"]);
    let stream = raw_stream(&sim, sim.ports().dashboard);
    let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
    assert!(lines.next().unwrap().unwrap().starts_with("Connected"));
    let mut ask = |line: &str| {
        (&stream).write_all(format!("{line}\n").as_bytes()).unwrap();
        lines.next().unwrap().unwrap()
    };
    ask("load production.urp");
    assert_eq!(ask("play"), "Starting program");
    watch.turn_until(|v| v[0] == Value::Uint32(2));
    ask("pause");
    watch.turn_until(|v| v[0] == Value::Uint32(4));
    ask("play");
    watch.turn_until(|v| v[0] == Value::Uint32(2));
    assert_eq!(ask("stop"), "Stopped");
    watch.turn_until(|v| v[0] == Value::Uint32(1));
    ask("power off");
    watch.turn_until(|v| v[1] == Value::Int32(3));
    ask("power on");
    watch.turn_until(|v| v[1] == Value::Int32(5));
    ask("brake release");
    watch.turn_until(|v| v[1] == Value::Int32(7));
    assert_eq!(ask("programState"), "STOPPED production.urp");
    assert_eq!(ask("quit"), "Disconnected");
    assert!(lines.next().is_none(), "the connection is closed");
}
