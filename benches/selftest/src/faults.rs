//! Faults in shaders, made by rules: each changes one expression of a WGSL file. What does not compile is no fault.

use std::ops::Range;

use regex::{Captures, Regex};

/// One changed expression.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fault {
    pub kind: &'static str,
    /// In the folder of shaders, without its ending.
    pub file: String,
    /// From 1.
    pub line: usize,
    pub function: String,
    /// Bytes of the source that are replaced.
    place: (usize, usize),
    replacement: String,
}

impl Fault {
    pub fn apply(&self, source: &str) -> String {
        let (start, end) = self.place;
        format!("{}{}{}", &source[..start], self.replacement, &source[end..])
    }

    /// The line before and after.
    pub fn difference(&self, source: &str) -> [String; 2] {
        let line =
            |text: &str| text.lines().nth(self.line - 1).unwrap_or_default().trim().to_owned();
        [line(source), line(&self.apply(source))]
    }
}

/// What is replaced wherever it stands, as expressions.
const RULES: &[(&str, &str, &str)] = &[
    ("sign", r" \+ ", " - "),
    ("sign", r" - ", " + "),
    ("sign", r" \+= ", " -= "),
    ("sign", r"([(\[] ?|, |[=*/] |return )-([a-z(])", "$1$2"),
    ("comparison turned", r" (<|<=) ", " > "),
    ("comparison turned", r" (>|>=) ", " < "),
    ("comparison turned", r" == ", " != "),
    ("comparison turned", r" != ", " == "),
    ("comparison turned", r" && ", " || "),
    ("comparison turned", r" \|\| ", " && "),
    ("one step late", r" (<|>) ", " $1= "),
    ("one step late", r" (<|>)= ", " $1 "),
    ("exit dropped", r"(continue|discard|break);", "{}"),
    ("term dropped", r"[\w.\[\]]+ [-+*]= [^;]*;", ""),
    ("factor inverted", r" \* ", " / "),
    ("factor inverted", r" / ", " * "),
    ("components swapped", r"\.x\b", ".y"),
    ("components swapped", r"\.[yzw]\b", ".x"),
    ("components swapped", r"\.([xyzw])([xyzw])([xyzw]*)\b", ".$2$1$3"),
    ("another call", r"\bmin\(", "max("),
    ("another call", r"\bmax\(", "min("),
    ("another call", r"\bfloor\(", "ceil("),
    ("another call", r"\bsin\(", "cos("),
    ("another call", r"\bcos\(", "sin("),
    ("another call", r"\bany\(", "all("),
    ("another call", r"\ball\(", "any("),
    ("call left out", r"\b(saturate|normalize|abs|sqrt|fract|exp|floor|round|ceil)\(", "("),
    ("constant off", r"\b(\d+\.\d+)\b", "($1 * 1.02)"),
    ("constant off", r"([^\w.]|^)([1-9]\d*u?)\b", "$1($2 + 1)"),
    ("index off by one", r"\[([^\[\]]+)\]", "[($1) + 1]"),
    (
        "half a texel off",
        r"(textureSampleLevel\((\w+), \w+, )",
        "${1}0.5 / vec2<f32>(textureDimensions($2)) + ",
    ),
    (
        "half a texel off",
        r"(textureSampleLevel\((\w+), \w+, )",
        "${1}0.5 / vec3<f32>(textureDimensions($2)) + ",
    ),
];
/// Calls that may be replaced by one of their first two arguments.
const REPLACED_BY_ARGUMENT: [&str; 4] = ["min", "max", "clamp", "mix"];
/// Calls whose arguments change places without effect, or that no other order compiles.
const ONE_ORDER: [&str; 5] = ["min", "max", "dot", "distance", "textureLoad"];

/// All faults of a file's functions and constants, in order.
pub fn faults(file: &str, source: &str) -> Vec<Fault> {
    let expression = |text: &str| Regex::new(text).expect("an expression");
    let in_comment =
        |at: usize| source[..at].rsplit('\n').next().is_some_and(|line| line.contains("//"));
    let mut made = Vec::new();
    for (function, within) in bodies(source) {
        let code = &source[..within.end];
        let each = |pattern: &str, change: &mut dyn FnMut(Captures<'_>)| {
            let is_code = |found: &Captures<'_>| {
                let start = found.get_match().start();
                start >= within.start && !in_comment(start)
            };
            expression(pattern).captures_iter(code).filter(is_code).for_each(change);
        };
        let mut change = |kind, place: Range<usize>, replacement: String| {
            if place.end <= code.len() && source[place.clone()] != replacement {
                let line = 1 + source[..place.start].matches('\n').count();
                let (file, function, place) =
                    (file.to_owned(), function.clone(), (place.start, place.end));
                made.push(Fault { kind, file, line, function, place, replacement });
            }
        };
        for (kind, pattern, template) in RULES {
            each(pattern, &mut |found| {
                let mut replacement = String::new();
                found.expand(template, &mut replacement);
                change(*kind, found.get_match().range(), replacement);
            });
        }
        each(r" ([-+*/]) ", &mut |found| {
            let (operator, whole) = (&found[1], found.get_match().range());
            let end = if "*/".contains(operator) {
                past_operand(code, whole.end)
            } else {
                past_term(code, whole.end)
            };
            change("term dropped", whole.start..end, String::new());
        });
        each(r"\(|, |= |return | [<>]=? | (&&|\|\|) ", &mut |found| {
            let start = found.get_match().end();
            for (end, operator) in
                [(past_operand(code, start), " * "), (past_term(code, start), " + ")]
            {
                if code[end..].starts_with(operator) {
                    change("term dropped", start..end + operator.len(), String::new());
                }
            }
        });
        each(r"\b(\w+)\(", &mut |found| {
            let (name, open) = (&found[1], found.get_match().end() - 1);
            let arguments = arguments(code, open);
            let whole = found.get_match().start()..past_bracket(code, open);
            let is_load = name == "textureLoad";
            for (number, argument) in arguments.iter().enumerate() {
                let text = &code[argument.clone()];
                if REPLACED_BY_ARGUMENT.contains(&name) && number < 2 {
                    change("call left out", whole.clone(), format!("({text})"));
                }
                if is_load && number > 0 {
                    let kind = if number == 1 { "texel off by one" } else { "mip off by one" };
                    change(kind, argument.clone(), format!("({text}) + 1"));
                }
                if name == "textureSampleLevel" && number == 3 {
                    change("mip off by one", argument.clone(), format!("({text}) + 1.0"));
                }
            }
            for pair in arguments.windows(2).filter(|_| !ONE_ORDER.contains(&name)) {
                let swapped = format!("{}, {}", &code[pair[1].clone()], &code[pair[0].clone()]);
                change("arguments swapped", pair[0].start..pair[1].end, swapped);
            }
        });
        let mut declared: Vec<String> = Vec::new();
        each(r"(?:\b(let|var) )?([^.\w]|^)([a-z_]\w*)\b(:?)", &mut |found| {
            let name = found.get(3).expect("a name");
            if found.get(1).is_some() || &found[4] == ":" {
                declared.push(name.as_str().to_owned());
            } else if declared.iter().any(|known| known == name.as_str()) {
                for other in &declared {
                    change("another variable", name.range(), other.clone());
                }
            }
        });
        let bindings: Vec<Captures<'_>> =
            expression(r"(?m)^@group.* (\w+): ([^;=]+);").captures_iter(source).collect();
        for (a, b) in bindings
            .iter()
            .flat_map(|a| bindings.iter().map(move |b| (a, b)))
            .filter(|(a, b)| a[2] == b[2])
        {
            each(&format!(r"\b{}\b", &a[1]), &mut |found| {
                change("another binding", found.get_match().range(), b[1].to_owned());
            });
        }
    }
    made.sort_unstable();
    made.dedup();
    made
}

/// Functions with their parameters, and values of constants.
fn bodies(source: &str) -> Vec<(String, Range<usize>)> {
    let mut start = 0;
    let lines = source.split_inclusive('\n').map(|line| {
        start += line.len();
        (line, start - line.len())
    });
    let body = |(line, start): (&str, usize)| {
        let (keyword, rest) = line.split_once(' ')?;
        let name = rest.split([':', '(']).next()?.to_owned();
        match keyword {
            "fn" => Some((name, start + "fn ".len()..start + source[start..].find("\n}")?)),
            "const" => Some((name, start + line.find('=')? + 1..start + line.len())),
            _ => None,
        }
    };
    lines.filter_map(body).collect()
}

/// Past the bracket that closes the one at a place.
fn past_bracket(code: &str, open: usize) -> usize {
    let mut depth = 0;
    let closes = |(_, c): &(usize, char)| {
        depth += i32::from("([".contains(*c)) - i32::from(")]".contains(*c));
        depth == 0
    };
    code[open..].char_indices().find(closes).map_or(code.len(), |(at, _)| open + at + 1)
}

/// Past an operand: a sign, and a name, a number or a bracket with the brackets and members that follow it.
fn past_operand(code: &str, start: usize) -> usize {
    let mut end = start;
    while let Some(next) = code[end..].chars().next() {
        let is_sign = end == start && "-!&*".contains(next);
        let is_type =
            next == '<' && ["vec2", "vec3", "vec4"].iter().any(|name| code[..end].ends_with(name));
        end = match next {
            '(' | '[' => past_bracket(code, end),
            '<' if is_type => end + code[end..].find('>').map_or(1, |at| at + 1),
            _ if is_sign || next.is_alphanumeric() || "_.".contains(next) => end + next.len_utf8(),
            _ => break,
        };
    }
    end
}

/// Past a product.
fn past_term(code: &str, start: usize) -> usize {
    let mut end = past_operand(code, start);
    while [" * ", " / ", " % "].iter().any(|operator| code[end..].starts_with(operator)) {
        end = past_operand(code, end + 3);
    }
    end
}

/// The arguments of a call whose bracket opens at a place.
fn arguments(code: &str, open: usize) -> Vec<Range<usize>> {
    let end = past_bracket(code, open).max(open + 2) - 1;
    let (mut start, mut found) = (open + 1, Vec::new());
    let mut at = start;
    while at < end {
        match code.as_bytes()[at] {
            b'(' | b'[' => at = past_bracket(code, at),
            b',' => {
                found.push(start..at);
                at += 2;
                start = at;
            }
            _ => at += 1,
        }
    }
    if start < end {
        found.push(start..end);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_of_a_shader_are_those_of_its_expressions() {
        let source = "
@group(1) @binding(0) var near: texture_2d<f32>;
@group(1) @binding(1) var far: texture_2d<f32>;
const SHARE: f32 = 0.5;
fn light(at: vec2<i32>, up: vec3<f32>) -> f32 {
    let facing = clamp(up.y, 0.0, 1.0); // a + b
    if facing < SHARE {
        return -facing;
    }
    return facing * 2.0 + textureLoad(near, at, 0).x;
}
";
        let all = faults("light", source);
        let line = |fault: &Fault| format!("{}: {}", fault.kind, fault.difference(source)[1]);
        let lines: Vec<String> = all.iter().map(line).collect();
        for expected in [
            "another binding: return facing * 2.0 + textureLoad(far, at, 0).x;",
            "arguments swapped: let facing = clamp(0.0, up.y, 1.0); // a + b",
            "call left out: let facing = (up.y); // a + b",
            "comparison turned: if facing > SHARE {",
            "components swapped: let facing = clamp(up.x, 0.0, 1.0); // a + b",
            "constant off: const SHARE: f32 = (0.5 * 1.02);",
            "mip off by one: return facing * 2.0 + textureLoad(near, at, (0) + 1).x;",
            "one step late: if facing <= SHARE {",
            "sign: return facing;",
            "term dropped: return 2.0 + textureLoad(near, at, 0).x;",
            "term dropped: return facing * 2.0;",
            "term dropped: return textureLoad(near, at, 0).x;",
            "texel off by one: return facing * 2.0 + textureLoad(near, (at) + 1, 0).x;",
        ] {
            assert!(lines.iter().any(|line| line == expected), "no {expected} in {lines:#?}");
        }
        assert!(lines.iter().all(|line| !line.contains("a - b") && !line.contains("var far")));
    }
}
