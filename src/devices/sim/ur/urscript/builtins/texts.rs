//! Texts, and what a program says.

use super::{Arguments, Builtin, nothing, value};
use crate::devices::sim::ur::body::Body;
use crate::devices::sim::ur::urscript::value::Value;

pub(super) const TABLE: &[Builtin] = &[
    value("textmsg", &["s1", "s2"], |b, a| {
        let text = [0, 1].map(|i| a.get(i).map_or_else(String::new, Value::text)).concat();
        b.log(text);
        nothing()
    }),
    value("popup", &["s", "title", "warning", "error", "blocking"], |b, a| {
        b.panel.popup = Some(a.text(0)?);
        nothing()
    }),
    value("to_str", &["val"], |_, a| a.text(0).map(Value::Text)),
    value("to_num", &["str"], |_, a| {
        let text = a.text(0)?;
        let number = text.trim().parse::<f64>().map_err(|_| format!("`{text}` is not a number"))?;
        Ok(text.trim().parse().map_or(Value::Float(number), Value::Int))
    }),
    value("str_cat", &["op1", "op2"], |_, a| Ok(Value::Text(a.text(0)? + &a.text(1)?))),
    value("str_len", &["str"], |_, a| Ok(Value::Int(a.text(0)?.len() as i32))),
    value("str_empty", &["str"], |_, a| Ok(Value::Bool(a.text(0)?.is_empty()))),
    value("str_at", &["src", "index"], |_, a| part(a, 1)),
    value("str_sub", &["src", "index", "len"], |_, a| {
        let length = a.get(2).map_or(Ok(usize::MAX), Value::index)?;
        part(a, length)
    }),
    value("str_find", &["src", "target", "start_from"], |_, a| {
        let (text, start) = (a.text(0)?, a.get(2).map_or(Ok(0), Value::index)?);
        let found = text.get(start..).and_then(|rest| rest.find(&a.text(1).unwrap_or_default()));
        Ok(Value::Int(found.map_or(-1, |at| (at + start) as i32)))
    }),
    value("socket_open", &["address", "port", "socket_name"], refuse_socket),
    value("socket_close", &["socket_name"], |_, _| nothing()),
];

fn part(arguments: &Arguments<'_>, length: usize) -> Result<Value, String> {
    let (text, index) = (arguments.text(0)?, arguments.need(1)?.index()?);
    let rest = text.get(index..).ok_or_else(|| format!("`{}`: index {index} is out of range", arguments.name))?;
    Ok(Value::Text(rest.chars().take(length).collect()))
}

/// As where nobody listens.
fn refuse_socket(body: &mut Body, _: &Arguments<'_>) -> Result<Value, String> {
    body.log("socket_open: sockets are not simulated");
    Ok(Value::Bool(false))
}
