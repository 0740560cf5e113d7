//! Known bytes, round trips, and garbage.

use bytes::Bytes;
use proptest::prelude::*;

use super::*;

fn packages(framer: &mut Framer) -> Result<Vec<Package>, CodecError> {
    let mut found = Vec::new();
    while let Some(package) = framer.next_package()? {
        found.push(package);
    }
    Ok(found)
}

fn one_package(bytes: &[u8]) -> Package {
    let mut framer = Framer::default();
    framer.push(bytes).unwrap();
    framer.next_package().unwrap().unwrap()
}

#[test]
fn known_bytes_of_the_handshake() {
    // Layouts of the guide: size, kind, payload.
    assert_eq!(Request::ProtocolVersion(2).to_bytes().unwrap()[..], [0, 5, 86, 0, 2]);
    assert_eq!(Request::ControllerVersion.to_bytes().unwrap()[..], [0, 3, 118]);
    assert_eq!(Request::Start.to_bytes().unwrap()[..], [0, 3, 83]);
    let names = vec!["timestamp".to_owned(), "actual_q".to_owned()];
    let setup = Request::SetupOutputs { frequency_hz: 125.0, names }.to_bytes().unwrap();
    assert_eq!(setup[..11], [0, 29, 79, 0x40, 0x5f, 0x40, 0, 0, 0, 0, 0]);
    assert_eq!(&setup[11..], b"timestamp,actual_q");
    let answer = Answer::from_package(one_package(b"\x00\x13O\x01DOUBLE,VECTOR6D")).unwrap();
    let fields = vec![FieldAnswer::Typed(DataType::Double), FieldAnswer::Typed(DataType::Vector6d)];
    assert_eq!(answer, Answer::SetupOutputs { recipe: 1, fields });
}

#[test]
fn a_trailing_comma_is_ignored_and_failures_are_told() {
    let package = |payload: &'static str| Package { kind: b'I', payload: Bytes::from(payload) };
    let request = Request::from_package(package("speed,timestamp,")).unwrap();
    assert_eq!(request, Request::SetupInputs { names: vec!["speed".into(), "timestamp".into()] });
    let answer = Answer::from_package(package("\0NOT_FOUND,IN_USE")).unwrap();
    assert_eq!(answer, Answer::SetupInputs { recipe: 0, fields: vec![FieldAnswer::NotFound, FieldAnswer::InUse] });
    assert!(Answer::from_package(package("\x01FLOAT")).is_err());
}

#[test]
fn sizes_below_the_header_break_the_stream_for_good() {
    for size in 0..3u8 {
        let mut framer = Framer::default();
        framer.push(&[0, size, 86]).unwrap();
        assert_eq!(framer.next_package(), Err(CodecError::Size { size: size.into() }));
        assert!(framer.push(&[0, 3, 83]).is_err());
        assert!(framer.next_package().is_err());
    }
}

#[test]
fn a_flood_is_refused() {
    let mut framer = Framer::default();
    let results: Vec<_> = (0..20).map(|_| framer.push(&[0xff; 65535])).collect();
    assert!(results.iter().any(Result::is_err), "memory must be bounded");
}

#[test]
fn text_messages_are_cut_at_255_bytes() {
    let text = TextMessage { message: "é".repeat(200), source: "script".into(), level: TextLevel::Error };
    let bytes = Answer::Text(text).to_bytes().unwrap();
    let Answer::Text(read) = Answer::from_package(one_package(&bytes)).unwrap() else { panic!() };
    assert_eq!(read.message, "é".repeat(127));
    assert_eq!((read.source.as_str(), read.level), ("script", TextLevel::Error));
}

#[test]
fn values_must_fit_the_recipe() {
    let recipe = Recipe { id: 3, types: vec![DataType::Int32, DataType::Vector3d] };
    assert!(recipe.encode(&[Value::Int32(1)]).is_err());
    assert!(recipe.encode(&[Value::Uint32(1), Value::Vector3d([0.0; 3])]).is_err());
    assert!(recipe.decode(&[0; 27]).is_err() && recipe.decode(&[0; 29]).is_err());
    let huge = Recipe { id: 1, types: vec![DataType::Vector6d; 1400] };
    assert!(huge.encode(&vec![Value::Vector6d([0.0; 6]); 1400]).is_err());
}

#[test]
fn setup_with_bad_names_is_not_encoded() {
    for name in ["", "a,b", "a b", "ü"] {
        assert!(Request::SetupInputs { names: vec![name.into()] }.to_bytes().is_err(), "{name}");
    }
    assert!(Request::SetupInputs { names: vec!["x".repeat(2049)] }.to_bytes().is_err());
}

fn any_value() -> impl Strategy<Value = Value> {
    prop_oneof![
        any::<bool>().prop_map(Value::Bool),
        any::<u8>().prop_map(Value::Uint8),
        any::<u32>().prop_map(Value::Uint32),
        any::<u64>().prop_map(Value::Uint64),
        any::<i32>().prop_map(Value::Int32),
        (-1e9..1e9f64).prop_map(Value::Double),
        prop::array::uniform3(-1e9..1e9f64).prop_map(Value::Vector3d),
        prop::array::uniform6(-1e9..1e9f64).prop_map(Value::Vector6d),
        prop::array::uniform6(any::<i32>()).prop_map(Value::Vector6Int32),
        prop::array::uniform6(any::<u32>()).prop_map(Value::Vector6Uint32),
    ]
}

proptest! {
    #[test]
    fn data_packages_come_back_however_they_are_cut(
        rows in prop::collection::vec(prop::collection::vec(any_value(), 0..12), 1..6),
        chunk in 1usize..40,
    ) {
        let recipes: Vec<Recipe> = rows.iter().enumerate()
            .map(|(i, row)| Recipe { id: i as u8, types: row.iter().map(Value::data_type).collect() }).collect();
        let stream: Vec<u8> = recipes.iter().zip(&rows).flat_map(|(r, row)| r.encode(row).unwrap()).collect();
        let mut framer = Framer::default();
        let mut found = Vec::new();
        for part in stream.chunks(chunk) {
            framer.push(part).unwrap();
            found.extend(packages(&mut framer).unwrap());
        }
        prop_assert_eq!(found.len(), rows.len());
        for (i, package) in found.into_iter().enumerate() {
            let Answer::Data { recipe, body } = Answer::from_package(package.clone()).unwrap() else { panic!() };
            prop_assert_eq!(usize::from(recipe), i);
            prop_assert_eq!(&recipes[i].decode(&body).unwrap(), &rows[i]);
            let Request::Data { body, .. } = Request::from_package(package).unwrap() else { panic!() };
            prop_assert_eq!(&recipes[i].decode(&body).unwrap(), &rows[i]);
        }
    }

    #[test]
    fn garbage_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..2000), chunk in 1usize..100) {
        let mut framer = Framer::default();
        for part in bytes.chunks(chunk) {
            let _ = framer.push(part);
            while let Ok(Some(package)) = framer.next_package() {
                let _ = (Request::from_package(package.clone()), Answer::from_package(package));
            }
        }
    }

    #[test]
    fn any_payload_of_any_kind_is_read_or_refused(kind in any::<u8>(), payload in prop::collection::vec(any::<u8>(), 0..300)) {
        let package = Package { kind, payload: Bytes::from(payload) };
        // What is read as an answer is written back as the same meaning.
        if let Ok(answer) = Answer::from_package(package.clone()) {
            let again = Answer::from_package(one_package(&answer.to_bytes().unwrap())).unwrap();
            prop_assert_eq!(format!("{answer:?}"), format!("{again:?}"));
        }
        let _ = Request::from_package(package);
    }
}
