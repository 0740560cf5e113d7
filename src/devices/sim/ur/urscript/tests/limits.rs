//! No text panics, hangs, or takes memory without end.

use proptest::prelude::*;

use super::*;
use crate::devices::sim::ur::urscript::Upload;

/// Runs a text for many cycles and gives how it ended.
fn end_of(text: &str) -> Slice {
    let body = body();
    let mut program = match Program::new(text, body) {
        Ok(program) => program,
        Err(why) => return Slice::Failed(why),
    };
    (0..500).map(|_| program.resume()).find(|slice| *slice != Slice::Running).unwrap_or(Slice::Running)
}

#[test]
fn growth_ends_in_an_exception() {
    for (text, why) in [
        ("x = [0, 0]\nwhile True:\n x = [x, x]\n sync()\nend", "nested deeper"),
        ("x = [0]\nwhile True:\n x = [x]\n sync()\nend", "nested deeper"),
        ("x = make_list(1500, 1)\ny = [x, x]", "values, at most"),
        ("x = make_list(2000000000, 1)", "values, at most"),
        ("x = struct(a=1)\nwhile True:\n x = struct(a=x, b=x)\n sync()\nend", "nested deeper"),
        ("x = [0, 0]\nwhile True:\n x[1] = x\n sync()\nend", "nested deeper"),
        ("s = \"ab\"\nwhile True:\n s = str_cat(s, s)\n sync()\nend", "at most 4096"),
        (
            "thread f():\n while True:\n sync()\n end\nend\nwhile True:\n t = run f()\n sync()\nend",
            "more than 32 threads",
        ),
        ("thread f():\n t = run f()\n sleep(1)\nend\nt = run f()\nwhile True:\n sync()\nend", "more than 32 threads"),
        ("thread f():\n t = run f()\nend\nt = run f()\nsleep(1)", "infinite loop"),
        ("def f():\n sync()\n f()\nend\nf()", "nested too deep"),
        ("thread f():\n while True:\n x = 1\n end\nend\nt = run f()\nsleep(1)", "infinite loop"),
        ("x = make_list(1999, 1)\nwhile True:\n y = x\nend", "infinite loop"),
        ("t = 0\nthread f():\n join t\nend\nt = run f()\nsleep(1)", "waits for its own end"),
    ] {
        let end = end_of(text);
        assert!(matches!(&end, Slice::Failed(found) if found.contains(why)), "{text}: {end:?}, not {why}");
    }
    let many: String = (0..200).map(|i| format!("x{i} = make_list(1999, 0)\nsync()\n")).collect();
    let end = end_of(&many);
    assert!(matches!(&end, Slice::Failed(why) if why.contains("too much memory")), "{end:?}");
    let wide = format!("norm({})", "1,".repeat(100));
    assert!(matches!(end_of(&wide), Slice::Failed(_)));
}

#[test]
fn what_is_given_back_may_be_taken_again() {
    for text in [
        "x = make_list(1900, 0)\ndef f(a):\n b = a\n return b\nend\nwhile True:\n y = f(x)\n sync()\nend",
        "thread f():\n x = make_list(1900, 0)\n sleep(1)\nend\nwhile True:\n t = run f()\n sync()\n sync()\n kill t\nend",
        "thread f():\n x = make_list(1900, 0)\nend\nwhile True:\n t = run f()\n join t\nend",
    ] {
        assert_eq!(end_of(text), Slice::Running, "{text}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn no_text_panics(picks in prop::collection::vec(0..WORDS.len(), 0..60)) {
        let text: String = picks.iter().map(|i| WORDS[*i]).collect();
        if let Ok(mut program) = Program::new(&text, body()) {
            (0..3).for_each(|_| drop(program.resume()));
        }
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut upload = Upload::default();
        for text in upload.push(&bytes).into_iter().chain(upload.push(b"\nend\nend\n")) {
            if let Ok(mut program) = Program::new(&text, body()) {
                drop(program.resume());
            }
        }
    }

    #[test]
    fn no_program_panics(picks in prop::collection::vec(0..STATEMENTS.len(), 0..25)) {
        let text: String = picks.iter().map(|i| STATEMENTS[*i]).collect();
        let opened = ["def ", "thread ", "if ", "while "].iter().map(|word| text.matches(word).count()).sum::<usize>();
        let text = text + &"end\n".repeat(opened);
        let body = body();
        if let Ok(mut program) = Program::new(&text, body.clone()) {
            for _ in 0..20 {
                drop(program.resume());
                body.borrow_mut().tick_drives();
            }
        }
    }
}

const WORDS: [&str; 52] = [
    "def ",
    "f",
    "(",
    ")",
    ":",
    "end ",
    "\n",
    "if ",
    "elif ",
    "else:",
    "while ",
    "return ",
    "x",
    " = ",
    "1",
    "2.5",
    "\"s\"",
    "[",
    "]",
    ",",
    "p[",
    "+",
    "-",
    "*",
    "/ ",
    "% ",
    "not ",
    "and ",
    "or ",
    "==",
    "<",
    "True ",
    "global ",
    "sync()",
    "movej(",
    "norm(",
    "sleep(",
    "#",
    "é",
    ".",
    "thread ",
    "run ",
    "join ",
    "kill ",
    "enter_critical ",
    "exit_critical ",
    "sec ",
    "struct(",
    "a=",
    "make_list(9,",
    "speedj(",
    "p",
];

const STATEMENTS: [&str; 32] = [
    "def f(a):\n",
    "thread g():\n",
    "if x == 1:\n",
    "while True:\n",
    "while x < 9:\n",
    "x = 1\n",
    "x = [x, x]\n",
    "global y = x\n",
    "x = f(x)\n",
    "x = x + 1\n",
    "t = run g()\n",
    "kill t\n",
    "join t\n",
    "enter_critical\n",
    "exit_critical\n",
    "sync()\n",
    "sleep(0.01)\n",
    "return x\n",
    "break\n",
    "halt\n",
    "x = struct(a=x)\n",
    "x.a = 2\n",
    "x[0] = y\n",
    "q = get_target_joint_positions()\n",
    "q[0] = q[0] + 0.1\n",
    "movej(q)\n",
    "stopj(2)\n",
    "speedj([0.1, 0, 0, 0, 0, 0], 1, 0.01)\n",
    "servoj(q)\n",
    "movel(get_target_tcp_pose(), t=1)\n",
    "set_tcp(p[0, 0, 0.1, 0, 0, 0])\n",
    "textmsg(x)\n",
];
