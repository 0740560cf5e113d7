//! Texts of faults, good and bad.

use proptest::prelude::*;

use super::*;

#[test]
fn texts_say_what_and_when() {
    let read = |text: &str| text.parse::<Planned>().unwrap();
    let planned = |when, fault| Planned { when, fault };
    let known = [
        ("protective_stop@move:3+0.4", When::Move { number: 3, after_s: 0.4 }, Fault::ProtectiveStop),
        ("emergency_stop@t:12.5", When::Time { at_s: 12.5 }, Fault::EmergencyStop),
        ("fragment:3@connect", When::Connect { after_s: 0.0 }, Fault::Fragment { bytes: 3 }),
        ("fragment:3@start+2", When::Connect { after_s: 2.0 }, Fault::Fragment { bytes: 3 }),
        ("drop@move:2", When::Move { number: 2, after_s: 0.1 }, Fault::Drop),
        (
            "digital_input:3=1@still:1",
            When::Still { number: 1, after_s: 0.0 },
            Fault::DigitalInput { bit: 3, on: true },
        ),
        ("tcp_offset:-2.5@t:1+1", When::Time { at_s: 2.0 }, Fault::TcpOffset { dz_mm: -2.5 }),
    ];
    for (text, when, fault) in known {
        assert_eq!(read(text), planned(when, fault), "{text}");
    }
    let name = "in_use:input_int_register_24@connect";
    assert_eq!(read(name).to_string(), name);
    assert_eq!(serde_json::to_string(&read(name)).unwrap(), format!("\"{name}\""));
    assert_eq!(serde_json::from_str::<Planned>(&format!("\"{name}\"")).unwrap(), read(name));
}

#[test]
fn every_fault_is_read_as_it_is_written() {
    let values = ["1", "2.5", "3=1", "timestamp", "10"];
    let valued = VALUED.iter().flat_map(|(name, _)| values.map(|v| format!("{name}:{v}").parse::<Fault>()));
    let valued: Vec<_> = valued.filter_map(Result::ok).collect();
    for (name, _) in VALUED {
        assert!(valued.iter().any(|f| f.to_string().starts_with(name)), "{name}");
    }
    for fault in PLAIN.into_iter().map(|(_, fault)| fault).chain(valued) {
        assert_eq!(fault.to_string().parse(), Ok(fault.clone()), "{fault}");
    }
}

#[test]
fn a_bad_text_is_told_what_is_allowed() {
    let error = |text: &str| text.parse::<Planned>().unwrap_err().to_string();
    for (text, parts) in [
        ("explode@t:1", ["`explode`", "protective_stop", "fragment:BYTES from 1 to 65535"]),
        ("fragment:0@t:1", ["`fragment:0`", "fragment:BYTES", "from 1 to 65535"]),
        ("slider:nan@t:1", ["`slider:nan`", "slider:FRACTION", "from 0 to 1"]),
        ("drop:1@t:1", ["`drop:1`", "drop, without a value", ""]),
        ("nan:a,b@t:1", ["`nan:a,b`", "nan:NAME", ""]),
        ("drop@move:0", ["`move:0`", "move:K", "K from 1"]),
        ("drop@t:nan", ["`t:nan`", "t:S", ""]),
        ("drop@noon", ["`noon`", "connect", "still:K"]),
        ("drop", ["`drop`", "FAULT@WHEN", "t:S"]),
    ] {
        let said = error(text);
        assert!(parts.iter().all(|part| said.contains(part)), "{text}: {said}");
    }
}

proptest! {
    #[test]
    fn no_text_panics_and_what_is_read_is_written_back(text in "[a-z_]{0,12}:?[0-9.=+e-]{0,5}@[a-z]{0,6}:?[0-9.+e-]{0,6}") {
        if let Ok(planned) = text.parse::<Planned>() {
            prop_assert_eq!(planned.to_string().parse::<Planned>().unwrap(), planned);
        }
    }

    #[test]
    fn times_come_back(number in 1u64.., after_s in 0.0..1e6f64) {
        for when in [When::Move { number, after_s }, When::Still { number, after_s }, When::Connect { after_s }] {
            prop_assert_eq!(when.to_string().parse::<When>().unwrap(), when);
        }
    }
}
