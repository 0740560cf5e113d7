use crate::events::{Format, Header, RawError, RawInfo};

const LEGACY: Format = Format::Evt21 { legacy_halves: true };
const LITTLE: Format = Format::Evt21 { legacy_halves: false };

fn parse(text: &str) -> Result<(Format, Option<u16>, Option<u16>), RawError> {
    Header::parse(text.as_bytes()).map(|header| (header.format, header.width, header.height))
}

#[test]
fn headers_of_all_ages() {
    let vga = (Format::Evt2, Some(640), Some(480));
    let hd = |format| (format, Some(1280), Some(720));
    for (text, expected) in [
        ("% format EVT3;height=720;width=1280\n% end\n", hd(Format::Evt3)),
        ("% evt 3.0\n% format EVT3;height=720;width=1280\n% geometry 1280x720\n% end\n", hd(Format::Evt3)),
        ("% evt 3.0\r\n% geometry 1280x720\r\n% end\r\n", hd(Format::Evt3)),
        ("% format EVT21;height=720;width=1280;endianness=legacy\n% end\n", hd(LEGACY)),
        ("% format EVT21;width=1280;height=720\n% endianness legacy\n% end\n", hd(LEGACY)),
        ("% format EVT21;width=1280;height=720\n% system_ID 49\n% end\n", hd(LEGACY)),
        ("% evt 2.1\n% geometry 1280x720\n% end\n", hd(LITTLE)),
        ("% evt 2.1\n% integrator_name Other\n% system_ID 49\n% geometry 1280x720\n", hd(LITTLE)),
        ("% Date 2020-09-25 07:48:31\n% integrator_name Prophesee\n% system_ID 21\n% evt 2.0\n", vga),
        ("% system_ID 21\n", vga),
        ("% system_ID 48\n", hd(Format::Evt3)),
        ("% evt 2.0\n% serial_number 00000157\n", (Format::Evt2, None, None)),
        ("% integrator_name Other\n% system_ID 21\n% evt 2.0\n", (Format::Evt2, None, None)),
    ] {
        assert_eq!(parse(text), Ok(expected), "{text}");
    }
}

#[test]
fn data_begins_where_the_header_ends() {
    for (head, data) in [
        ("% evt 3.0\n% geometry 640x480\n% end\n", &b"% not a header\n"[..]),
        ("% evt 3.0\n% geometry 640x480\n", b"\x90\x8d\xe6\x6d"),
        ("% evt 3.0\n% geometry 640x480\n", b"% \x00\x80\x0a\x60"),
        ("% evt 3.0\n% geometry 640x480\n", b"% cut before its end"),
        ("% evt 3.0\n% geometry 640x480\n", b""),
        ("% evt 3.0\r\n% geometry 640x480\r\n% end\r\n", b"\x0a\x60"),
        ("% evt 3.0\r\n% geometry 640x480\r\n", b"\x0d\x80\x0a\x60"),
    ] {
        let header = Header::parse(&[head.as_bytes(), data].concat()).unwrap();
        assert_eq!(header.len_bytes, head.len(), "{data:?}");
        assert_eq!(header.fields.len(), 2);
    }
}

#[test]
fn errors_name_what_was_found() {
    for (text, found, advice) in [
        ("", "empty", "closed"),
        ("\u{7f}ELF\u{2}\u{1}", "ELF", "begin with `% `"),
        ("% Date 2020-09-25\n% end\n", "no event format", "% evt 3.0"),
        ("% format HISTO3D;height=320;width=320\n% end\n", "HISTO3D", "EVT2.1"),
        ("% evt 4.0\n% end\n", "4.0", "EVT3"),
        ("% Data file containing CD events.\n% Version 2\n", "DAT", "EVT3"),
        ("% evt 2.1\n% endianness big\n% end\n", "endianness big", "legacy"),
        ("% format EVT3;height=720;width=1280\n% evt 2.0\n% end\n", "evt3", "% evt 2.0"),
        ("% format EVT3;height=720;width=1280\n% geometry 640x480\n% end\n", "1280x720", "640x480"),
        ("% evt 3.0\n% geometry 1280\n% end\n", "1280x", "WIDTHxHEIGHT"),
        ("% evt 3.0\n% geometry 0x720\n% end\n", "0x720", "1 to 2048"),
        ("% format EVT3;height=-1;width=1280\n% end\n", "1280x-1", "1 to 2048"),
    ] {
        let message = RawInfo::from_bytes(text.as_bytes()).unwrap_err().to_string();
        assert!(message.contains(found) && message.contains(advice), "{text:?}: {message}");
    }
}

#[test]
fn written_headers_are_read_back() {
    for format in super::FORMATS {
        let mut header = Header::new(format, 1280, 720);
        header.fields.push(("serial_number".into(), "00051\n% evt 2.0".into()));
        header.fields.push(("evt".into(), "left over".into()));
        let bytes = header.to_bytes();
        let read = Header::parse(&[&bytes[..], b"% data\n"].concat()).unwrap();
        assert_eq!((read.format, read.width, read.height), (format, Some(1280), Some(720)));
        assert_eq!(read.len_bytes, bytes.len());
        assert_eq!(read.field("serial_number"), Some("00051 % evt 2.0"));
        assert_eq!(read.to_bytes(), bytes);
    }
    let unsized_header = Header { width: None, height: None, ..Header::new(Format::Evt2, 1, 1) };
    let read = Header::parse(&unsized_header.to_bytes()).unwrap();
    assert_eq!((read.width, read.height), (None, None));
}
