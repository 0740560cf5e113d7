//! Tokens to statements, by recursive descent.

use std::rc::Rc;

use super::ast::{Access, Argument, Binary, Block, Expr, Function, Kind, Place, Statement, Unary, Upload};
use super::lexer::{self, Token, Word};

/// Blocks and brackets inside each other; deeper text is refused rather than overflowing the stack.
const MAX_DEPTH: usize = 50;

/// Operators or indices in one chain, which nest as deep when they are evaluated.
const MAX_CHAIN: usize = 50;

/// Arguments or parameters of one function.
const MAX_ARGUMENTS: usize = 32;

const KEYWORDS: [&str; 26] = [
    "def",
    "end",
    "if",
    "elif",
    "else",
    "while",
    "return",
    "break",
    "continue",
    "pass",
    "halt",
    "global",
    "local",
    "and",
    "or",
    "xor",
    "not",
    "True",
    "False",
    "thread",
    "sec",
    "run",
    "join",
    "kill",
    "enter_critical",
    "exit_critical",
];

/// Operators from loosest to tightest.
const LEVELS: [&[(&str, Binary)]; 5] = [
    &[("or", Binary::Or), ("xor", Binary::Xor)],
    &[("and", Binary::And)],
    &[
        ("==", Binary::Equal),
        ("!=", Binary::Unequal),
        ("<=", Binary::LessEqual),
        (">=", Binary::GreaterEqual),
        ("<", Binary::Less),
        (">", Binary::Greater),
    ],
    &[("+", Binary::Plus), ("-", Binary::Minus)],
    &[("*", Binary::Times), ("/", Binary::Over), ("%", Binary::Modulo)],
];

/// Reads an uploaded text: one `def` or `sec` (its body is the program), or plain statements.
pub(super) fn upload(text: &str) -> Result<Upload, String> {
    let tokens = lexer::tokens(text)?;
    let mut parser = Parser { tokens, next: 0, depth: 0 };
    let secondary = parser.is("sec");
    let mut statements = if secondary { vec![parser.secondary()?] } else { parser.block(&[])? };
    if parser.peek() != &Word::End {
        return Err(parser.unexpected(if secondary { "nothing after a secondary program" } else { "a statement" }));
    }
    let single = statements.len() == 1;
    let main = match statements.pop() {
        Some(Statement { kind: Kind::Def(function), .. }) if single => {
            Rc::into_inner(function).ok_or_else(|| "the program is shared".to_owned())?
        }
        last => {
            statements.extend(last);
            Function { name: "script".into(), parameters: Vec::new(), body: statements }
        }
    };
    Ok(Upload { main, secondary })
}

struct Parser {
    tokens: Vec<Token>,
    next: usize,
    depth: usize,
}

impl Parser {
    fn token(&self) -> &Token {
        // The lexer always appends an end, and `advance` never passes it.
        &self.tokens[self.next]
    }

    fn peek(&self) -> &Word {
        &self.token().word
    }

    fn advance(&mut self) -> Word {
        let word = self.peek().clone();
        self.next = (self.next + 1).min(self.tokens.len() - 1);
        word
    }

    fn unexpected(&self, wanted: &str) -> String {
        format!("line {}: found {:?}, expected {wanted}", self.token().line, self.peek())
    }

    fn is(&self, text: &str) -> bool {
        match self.peek() {
            Word::Name(name) => name == text,
            Word::Sign(sign) => *sign == text,
            _ => false,
        }
    }

    fn take(&mut self, text: &str) -> bool {
        let found = self.is(text);
        if found {
            self.advance();
        }
        found
    }

    fn need(&mut self, text: &str) -> Result<(), String> {
        if self.take(text) { Ok(()) } else { Err(self.unexpected(&format!("`{text}`"))) }
    }

    fn name(&mut self) -> Result<String, String> {
        match self.peek() {
            Word::Name(name) if !KEYWORDS.contains(&name.as_str()) => {
                let name = name.clone();
                self.advance();
                Ok(name)
            }
            _ => Err(self.unexpected("a name")),
        }
    }

    /// Counts how deep `parse` is nested.
    fn deeper<T>(&mut self, parse: impl FnOnce(&mut Self) -> Result<T, String>) -> Result<T, String> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(format!("line {}: nested deeper than {MAX_DEPTH}", self.token().line));
        }
        let parsed = parse(self);
        self.depth -= 1;
        parsed
    }

    fn link(&self, chain: &mut usize) -> Result<(), String> {
        *chain += 1;
        if *chain <= MAX_CHAIN {
            Ok(())
        } else {
            Err(self.unexpected(&format!("at most {MAX_CHAIN} operators in a row")))
        }
    }

    /// Statements up to one of the closing words, which is left.
    fn block(&mut self, closing: &[&str]) -> Result<Block, String> {
        let mut statements = Vec::new();
        while self.peek() != &Word::End && !closing.iter().any(|c| self.is(c)) {
            if !self.take(";") {
                statements.push(self.deeper(Self::statement)?);
            }
        }
        Ok(statements)
    }

    fn statement(&mut self) -> Result<Statement, String> {
        let line = self.token().line;
        let word = match self.peek() {
            Word::Name(name) => name.clone(),
            _ => String::new(),
        };
        let simple = [
            ("break", Kind::Break),
            ("continue", Kind::Continue),
            ("pass", Kind::Pass),
            ("halt", Kind::Halt),
            ("enter_critical", Kind::EnterCritical),
            ("exit_critical", Kind::ExitCritical),
        ];
        for (text, kind) in simple {
            if self.take(text) {
                return Ok(Statement { line, kind });
            }
        }
        let kind = match word.as_str() {
            "def" => Kind::Def(self.definition("def")?),
            "thread" => Kind::Thread(self.definition("thread")?),
            "if" => self.branches()?,
            "while" => self.repetition()?,
            "return" => self.returned()?,
            "join" => Kind::Join(self.after("join")?),
            "kill" => Kind::Kill(self.after("kill")?),
            "global" | "local" => {
                self.advance();
                let place = if word == "global" { Place::Global } else { Place::Local };
                let name = self.name()?;
                self.need("=")?;
                Kind::Assign { place, name, path: Vec::new(), value: self.expr()? }
            }
            _ => self.assignment_or_expr()?,
        };
        Ok(Statement { line, kind })
    }

    fn secondary(&mut self) -> Result<Statement, String> {
        let line = self.token().line;
        Ok(Statement { line, kind: Kind::Def(self.definition("sec")?) })
    }

    fn after(&mut self, keyword: &str) -> Result<Expr, String> {
        self.need(keyword)?;
        self.expr()
    }

    fn definition(&mut self, keyword: &str) -> Result<Rc<Function>, String> {
        self.need(keyword)?;
        let name = self.name()?;
        self.need("(")?;
        let mut parameters = Vec::new();
        while !self.take(")") {
            parameters.push(self.name()?);
            self.comma(")", parameters.len())?;
        }
        self.need(":")?;
        let body = self.block(&["end"])?;
        self.need("end")?;
        Ok(Rc::new(Function { name, parameters, body }))
    }

    /// Between two of at most so many parameters.
    fn comma(&mut self, closing: &str, count: usize) -> Result<(), String> {
        if count > MAX_ARGUMENTS {
            return Err(self.unexpected(&format!("at most {MAX_ARGUMENTS} parameters")));
        }
        if self.is(closing) { Ok(()) } else { self.need(",") }
    }

    fn branches(&mut self) -> Result<Kind, String> {
        self.need("if")?;
        let mut branches = Vec::new();
        loop {
            let condition = self.expr()?;
            self.need(":")?;
            branches.push((condition, self.block(&["elif", "else", "end"])?));
            if !self.take("elif") {
                break;
            }
        }
        let mut otherwise = Vec::new();
        if self.take("else") {
            self.need(":")?;
            otherwise = self.block(&["end"])?;
        }
        self.need("end")?;
        Ok(Kind::If { branches, otherwise })
    }

    fn repetition(&mut self) -> Result<Kind, String> {
        self.need("while")?;
        let condition = self.expr()?;
        self.need(":")?;
        let body = self.block(&["end"])?;
        self.need("end")?;
        Ok(Kind::While { condition, body })
    }

    fn returned(&mut self) -> Result<Kind, String> {
        self.need("return")?;
        let closing = ["end", "elif", "else", ";"].iter().any(|word| self.is(word));
        let nothing = self.token().opens_line || closing;
        Ok(Kind::Return(if nothing { None } else { Some(self.expr()?) }))
    }

    fn assignment_or_expr(&mut self) -> Result<Kind, String> {
        let target = self.expr()?;
        if !self.take("=") {
            return Ok(Kind::Expr(target));
        }
        let value = self.expr()?;
        let (name, path) = place_of(target).ok_or_else(|| self.unexpected("a variable before `=`"))?;
        Ok(Kind::Assign { place: Place::Nearest, name, path, value })
    }

    fn expr(&mut self) -> Result<Expr, String> {
        self.deeper(|p| p.binary(0))
    }

    fn binary(&mut self, level: usize) -> Result<Expr, String> {
        let Some(operators) = LEVELS.get(level) else { return self.deeper(Self::unary) };
        let mut left = self.binary(level + 1)?;
        let mut chain = 0;
        while let Some((text, operator)) = operators.iter().find(|(text, _)| self.is(text)) {
            self.need(text)?;
            self.link(&mut chain)?;
            let right = self.binary(level + 1)?;
            left = Expr::Binary(*operator, Box::new(left), Box::new(right));
        }
        Ok(left)
    }

    fn unary(&mut self) -> Result<Expr, String> {
        if self.take("-") {
            return Ok(Expr::Unary(Unary::Minus, Box::new(self.deeper(Self::unary)?)));
        }
        if self.take("not") {
            // Looser than a comparison, tighter than `and`.
            return Ok(Expr::Unary(Unary::Not, Box::new(self.deeper(|p| p.binary(2))?)));
        }
        let value = self.primary()?;
        self.parts(value)
    }

    /// Indices and members behind a value; `a[1, 2]` is `a[1][2]`.
    fn parts(&mut self, mut value: Expr) -> Result<Expr, String> {
        let mut chain = 0;
        while !self.token().opens_line && (self.is("[") || self.is(".")) {
            if self.take(".") {
                self.link(&mut chain)?;
                value = Expr::Part(Box::new(value), Box::new(Access::Member(self.name()?)));
                continue;
            }
            self.need("[")?;
            loop {
                self.link(&mut chain)?;
                value = Expr::Part(Box::new(value), Box::new(Access::Index(self.expr()?)));
                if self.take("]") {
                    break;
                }
                self.need(",")?;
            }
        }
        Ok(value)
    }

    fn primary(&mut self) -> Result<Expr, String> {
        let word = self.peek().clone();
        match word {
            Word::Int(v) => Ok(self.literal(Expr::Int(v))),
            Word::Float(v) => Ok(self.literal(Expr::Float(v))),
            Word::Text(v) => Ok(self.literal(Expr::Text(v))),
            Word::Name(name) => self.named(&name),
            Word::Sign("(") => {
                self.need("(")?;
                let inside = self.expr()?;
                self.need(")")?;
                Ok(inside)
            }
            Word::Sign("[") => Ok(Expr::List(self.listed()?)),
            Word::Sign(_) | Word::End => Err(self.unexpected("a value")),
        }
    }

    fn literal(&mut self, value: Expr) -> Expr {
        self.advance();
        value
    }

    fn named(&mut self, name: &str) -> Result<Expr, String> {
        if self.take("True") {
            return Ok(Expr::Bool(true));
        }
        if self.take("False") {
            return Ok(Expr::Bool(false));
        }
        if self.take("run") {
            let name = self.name()?;
            self.need("(")?;
            return Ok(Expr::Run { name, arguments: self.arguments()? });
        }
        let name = self.name().map_err(|e| format!("{e} instead of `{name}`"))?;
        let same_line = !self.token().opens_line;
        if name == "p" && same_line && self.is("[") {
            return self.pose_or_item(name);
        }
        if same_line && self.take("(") {
            let arguments = self.arguments()?;
            return if name == "struct" { self.members(arguments) } else { Ok(Expr::Call { name, arguments }) };
        }
        Ok(Expr::Name(name))
    }

    /// `p[...]`: a pose has six numbers; with fewer it is an item of a variable that is called `p`.
    fn pose_or_item(&mut self, name: String) -> Result<Expr, String> {
        let mut items = self.listed()?;
        match items.pop() {
            Some(index) if items.is_empty() => {
                Ok(Expr::Part(Box::new(Expr::Name(name)), Box::new(Access::Index(index))))
            }
            last => {
                items.extend(last);
                Ok(Expr::Pose(items))
            }
        }
    }

    fn members(&self, arguments: Vec<Argument>) -> Result<Expr, String> {
        let named = arguments.into_iter().map(|a| a.name.map(|name| (name, a.value)));
        let members: Option<Vec<_>> = named.collect();
        members.map(Expr::Struct).ok_or_else(|| self.unexpected("named members in `struct(...)`"))
    }

    fn listed(&mut self) -> Result<Vec<Expr>, String> {
        self.need("[")?;
        let mut items = Vec::new();
        while !self.take("]") {
            items.push(self.expr()?);
            if !self.is("]") {
                self.need(",")?;
            }
        }
        Ok(items)
    }

    fn arguments(&mut self) -> Result<Vec<Argument>, String> {
        let mut arguments = Vec::new();
        while !self.take(")") {
            let value = self.expr()?;
            arguments.push(match value {
                Expr::Name(name) if self.take("=") => Argument { name: Some(name), value: self.expr()? },
                value => Argument { name: None, value },
            });
            self.comma(")", arguments.len())?;
        }
        Ok(arguments)
    }
}

/// A variable and the steps into it, where an expression is one.
fn place_of(target: Expr) -> Option<(String, Vec<Access>)> {
    match target {
        Expr::Name(name) => Some((name, Vec::new())),
        Expr::Part(inside, access) => {
            let (name, mut path) = place_of(*inside)?;
            path.push(*access);
            Some((name, path))
        }
        _ => None,
    }
}
