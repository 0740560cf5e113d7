//! Functions of the controller.

use super::*;

/// What an expression is, as a number; a truth is 1.
fn value(expression: &str) -> f64 {
    let text =
        format!("v = {expression}\nif v == True: v = 1 elif v == False: v = 0 end\nwrite_output_float_register(0, v)");
    register_0(&body(), &text)
}

#[test]
fn numbers_lists_and_texts() {
    for (expression, known) in [
        ("sqrt(9)", 3.0),
        ("abs(-4)", 4.0),
        ("floor(-1.5)", -2.0),
        ("ceil(1.2)", 2.0),
        ("pow(2, 5)", 32.0),
        ("log(10, 1000)", 3.0),
        ("sin(d2r(30))", 0.5),
        ("r2d(acos(0))", 90.0),
        ("atan2(1, -1) * 4", 3.0 * std::f64::consts::PI),
        ("length([1, 2, 3]) + get_list_length(p[0, 0, 0, 0, 0, 0])", 9.0),
        ("norm([3, 4])", 5.0),
        ("norm(p[0, 3, 4, 9, 9, 9])", 5.0),
        ("to_num(\"2.5\") + to_num(\"-1\")", 1.5),
        ("str_len(str_cat(\"ab\", \"cde\"))", 5.0),
        ("to_num(str_sub(\"a12b\", 1, 2)) + str_find(\"xyz\", \"z\")", 14.0),
        ("str_at(\"abc\", 1) == \"b\"", 1.0),
        ("str_empty(to_str(\"\"))", 1.0),
        ("length(make_list(5, 0.0))", 5.0),
        ("integer_to_binary_list(5)[2]", 1.0),
        ("random() < 1.0", 1.0),
        ("get_steptime() * 1000", 2.0),
        ("socket_open(\"192.168.0.1\", 5000)", 0.0),
    ] {
        let found = value(expression);
        assert!((found - known).abs() < 1e-9, "{expression} is {found}, not {known}");
    }
}

#[test]
fn poses() {
    let quarter = "p[0.1, 0.2, 0.3, 0, 0, d2r(90)]";
    for (expression, known) in [
        (format!("pose_trans({quarter}, p[1, 0, 0, 0, 0, 0])[1]"), 1.2),
        (format!("pose_trans(pose_inv({quarter}), {quarter})[0]"), 0.0),
        (format!("pose_add({quarter}, p[1, 0, 0, 0, 0, 0])[0]"), 1.1),
        (format!("pose_sub({quarter}, p[1, 0, 0, 0, 0, 0])[0]"), -0.9),
        (format!("pose_add({quarter}, pose_sub(p[0, 0, 1, 1, 0, 0], {quarter}))[3]"), 1.0),
        (format!("pose_dist({quarter}, p[0.1, 0.2, 1.3, 0, 0, 0])"), 1.0),
        (format!("interpolate_pose({quarter}, p[0.1, 0.2, 0.3, 0, 0, 0], 0.5)[5]"), std::f64::consts::FRAC_PI_4),
        ("rpy2rotvec([0, 0, 1])[2]".into(), 1.0),
        ("rotvec2rpy([0, 1, 0])[1]".into(), 1.0),
        ("pose_dist(get_forward_kin(get_inverse_kin(get_target_tcp_pose())), get_target_tcp_pose())".into(), 0.0),
        (
            "get_forward_kin(get_target_joint_positions(), p[0, 0, 0, 0, 0, 0])[2] - get_actual_tool_flange_pose()[2]"
                .into(),
            0.0,
        ),
        ("get_inverse_kin_has_solution(p[5, 0, 0, 0, 0, 0])".into(), 0.0),
        ("get_inverse_kin_has_solution(get_target_tcp_pose())".into(), 1.0),
        ("is_within_safety_limits([0, 0, 9, 0, 0, 0])".into(), 0.0),
        ("norm(get_actual_tcp_speed()) + norm(get_actual_joint_speeds())".into(), 0.0),
        ("pose_dist(get_target_waypoint(), get_target_tcp_pose())".into(), 0.0),
    ] {
        let found = value(&expression);
        assert!((found - known).abs() < 1e-6, "{expression} is {found}, not {known}");
    }
}

#[test]
fn signals_and_registers() {
    let body = body();
    let text = "set_standard_digital_out(1, True) set_configurable_digital_out(0, True) set_tool_digital_out(1, True)
                set_digital_out(0, True) set_digital_out(0, False)
                set_standard_analog_out(1, 0.25) set_analog_outputdomain(1, 1)
                write_output_boolean_register(70, get_digital_out(8)) write_output_boolean_register(3, True)
                write_output_integer_register(5, -7) write_output_float_register(6, 1.5)
                write_output_float_register(0, read_output_integer_register(5) + read_output_float_register(6))
                if read_output_boolean_register(70) and get_standard_digital_in(2):
                  write_output_integer_register(1, read_input_integer_register(2) + 1)
                end";
    body.borrow_mut().digital_inputs = 4;
    assert_eq!(register_0(&body, text), -5.5);
    let body = body.borrow();
    assert_eq!(body.digital_outputs, 1 << 1 | 1 << 8 | 1 << 17);
    assert_eq!((body.io.analog(1), body.io.bit(70), body.io.word(false), body.output_int[1]), (2.5, true, 8, 1));
}

#[test]
fn settings_of_the_robot() {
    let body = body();
    let text = "set_tcp(p[0.01, 0.02, 0.1, 0, 0, 0]) set_payload(2.5, [0.1, 0.2, 0.3])
                t = get_tcp_offset() c = get_target_payload_cog()
                write_output_float_register(0, get_target_payload() + t[2] + c[1])
                set_target_payload(1.5, [0, 0, 0.1], [1, 2, 3, 0, 0, 0])
                force_mode_set_damping(0.1) zero_ftsensor() textmsg(\"x = \", [1, 2.5]) popup(\"stop?\", blocking=False)";
    assert!((register_0(&body, text) - 2.8).abs() < 1e-12);
    let mut body = body.borrow_mut();
    assert_eq!((body.config.payload_kg, body.payload_inertia_kg_m2[1]), (1.5, 2.0));
    assert_eq!(body.take_log(), ["x = [1, 2.5]"]);
    assert_eq!(body.panel.popup.as_deref(), Some("stop?"));
    let flange = body.motion.base_from_flange();
    let tcp = body.motion.base_from_tcp(&body.motion.target());
    assert!((flange.translation_m()[2] - tcp.translation_m()[2]).abs() > 0.05, "the TCP moved");
}

#[test]
fn a_protective_stop_of_the_program() {
    let body = body();
    body.borrow_mut().runtime = Runtime::Playing;
    run("protective_stop()", &body);
    let body = body.borrow();
    assert_eq!((body.safety, body.runtime), (crate::devices::sim::ur::body::Safety::ProtectiveStop, Runtime::Paused));
}
