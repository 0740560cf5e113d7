//! What both sides of the wire do with bytes: shared by the fuzz target and the test over its corpus.

use cellcal::devices::rtde::{Answer, DataType, Framer, MAX_PACKAGE_BYTES, Package, Recipe, Request};

/// Reads bytes as both sides do; what waits undecoded stays bounded.
pub(crate) fn read_anything(bytes: &[u8]) {
    // The first byte says in which pieces the rest arrives.
    let (first, rest) = bytes.split_first().map_or((1, bytes), |(first, rest)| (usize::from(*first) + 1, rest));
    let mut framer = Framer::default();
    let recipe = Recipe { id: 1, types: vec![DataType::Double, DataType::Vector6d, DataType::Bool] };
    for piece in rest.chunks(first) {
        if framer.push(piece).is_err() {
            return;
        }
        while let Ok(Some(package)) = framer.next_package() {
            let Package { payload, .. } = &package;
            assert!(payload.len() <= MAX_PACKAGE_BYTES);
            let _ = recipe.decode(payload);
            if let Ok(request) = Request::from_package(package.clone()) {
                // What was understood can be said again.
                let _ = request.to_bytes();
            }
            if let Ok(answer) = Answer::from_package(package) {
                let _ = answer.to_bytes();
            }
        }
    }
}
