//! Settings at random, repeatable by a seed.

use glam::DVec3;
use serde_json::Value;

use super::PipelineKind;
use fathom_base::parameter::{self, Allowed, Range};
use fathom_scene::pcg;

/// Repeatable numbers in 0…1.
pub struct Random(u32);

impl Random {
    pub fn new(seed: u32) -> Self {
        Self(seed)
    }

    pub fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(1);
        f64::from(pcg(self.0)) / 4_294_967_296.0
    }

    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.number()
    }

    pub fn direction(&mut self) -> DVec3 {
        DVec3::from([(); 3].map(|()| self.within(-1.0, 1.0))).normalize()
    }

    fn choose<'a>(&mut self, names: &[&'a str]) -> &'a str {
        names[(self.number() * names.len() as f64) as usize]
    }
}

/// The text with one name of each list `a|b`, and a number of each range `0.5..2`; of `3..7`, which has no point, a whole one.
pub fn text(text: &str, random: &mut Random) -> String {
    let is_end = |c: char| " =,[]".contains(c);
    let drawn = |part: &str| {
        let (name, end) = part.split_at(part.trim_end_matches(is_end).len());
        let name = random.choose(&name.split('|').collect::<Vec<_>>());
        let ends = name.split_once("..").map(|(low, high)| [low, high].map(str::parse));
        let Some([Ok(low), Ok(high)]) = ends else { return format!("{name}{end}") };
        let is_whole = !name.replacen("..", "", 1).contains('.');
        let number: f64 = random.within(low, if is_whole { high + 1.0 } else { high });
        format!("{}{end}", if is_whole { number.floor() } else { f64::from(number as f32) })
    };
    text.split_inclusive(is_end).map(drawn).collect()
}

/// A tree of a pipeline's parameters with each at random: any choice, and numbers from 0.7 times their value to 1.4 times. What does not go
/// with those before it stays as it is.
pub fn parameters(kind: &PipelineKind, mut tree: Value, random: &mut Random) -> Value {
    let mut fields = (kind.fields)();
    let first = (random.number() * fields.len() as f64) as usize;
    fields.rotate_left(first);
    for field in fields {
        let Some(value) = parameter::get(&tree, &field.path) else { continue };
        let (drawn, mut other) = (near(value, field.allowed, random), tree.clone());
        if parameter::set(&mut other, &field.path, drawn).is_ok() {
            tree = (kind.checked)(&other).unwrap_or(tree);
        }
    }
    tree
}

/// A value of a parameter near this one.
pub fn near(value: &Value, allowed: Allowed, random: &mut Random) -> Value {
    match (value, allowed) {
        (Value::Array(all), _) => all.iter().map(|value| near(value, allowed, random)).collect(),
        (_, Allowed::Names(names)) => random.choose(names).into(),
        (_, Allowed::Flag) => (random.number() < 0.5).into(),
        (Value::Number(number), Allowed::Numbers(Range { low, high })) => {
            // A share of nothing may be any share.
            let share = Some(random.number()).filter(|_| value == 0.0 && high == 1.0);
            let scaled = random.within(0.7, 1.4) * number.as_f64().unwrap_or_default();
            let drawn = share.unwrap_or(scaled).clamp(low, high);
            Value::from(if number.is_f64() { drawn } else { drawn.round() })
        }
        _ => value.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_parameters_are_drawn_and_all_go_together() {
        let random = &mut Random::new(1);
        assert_eq!(text("a.b=[1..1,0.5..0.5] c=x|x", random), "a.b=[1,0.5] c=x");
        let file = fathom_scene::SceneFile::load("tank").unwrap();
        for kind in crate::KINDS.iter().filter(|kind| kind.name != "scalar_ao") {
            let plain = (kind.defaults)(&file);
            let drawn = parameters(kind, plain.clone(), random);
            let (all, is_same) = (parameter::leaves(&plain), |path: &&String| {
                parameter::get(&drawn, path) == parameter::get(&plain, path)
            });
            assert!((kind.checked)(&drawn).is_ok(), "{}: {drawn}", kind.name);
            assert!(3 * all.iter().filter(is_same).count() < all.len(), "{}: {drawn}", kind.name);
        }
    }
}
