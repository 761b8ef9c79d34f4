//! Parameters of cells. A run has thousands of cells that differ in one or two parameters, so cells share what is alike.

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Map, Value};

/// A tree of parameters. Each of its groups is held once, by whatever number of cells.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(from = "Map<String, Value>")]
#[schemars(with = "Map<String, Value>", inline, description = "")]
pub struct Params(Box<[ParamGroup]>);

/// Its name and value.
type ParamGroup = Arc<(String, Value)>;

thread_local! {
    /// By name and JSON.
    static KNOWN: RefCell<HashMap<String, ParamGroup>> = RefCell::default();
}

fn shared(name: String, value: Value) -> ParamGroup {
    let key = format!("{name}:{value}");
    KNOWN.with_borrow_mut(|known| {
        known.entry(key).or_insert_with(|| Arc::new((name, value))).clone()
    })
}

impl Params {
    /// A group or parameter by its name.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.0.iter().find(|group| group.0 == name).map(|group| &group.1)
    }

    /// A parameter by its dotted path.
    pub fn lookup(&self, path: &str) -> Option<&Value> {
        let mut names = path.split('.');
        let group = self.get(names.next()?)?;
        names.try_fold(group, |value, name| value.get(name))
    }

    pub fn to_map(&self) -> Map<String, Value> {
        self.0.iter().map(|group| ParamGroup::unwrap_or_clone(group.clone())).collect()
    }
}

impl From<Map<String, Value>> for Params {
    fn from(tree: Map<String, Value>) -> Self {
        Self(tree.into_iter().map(|(name, value)| shared(name, value)).collect())
    }
}

/// Of a table; anything else has no parameters.
impl From<Value> for Params {
    fn from(tree: Value) -> Self {
        if let Value::Object(tree) = tree { tree.into() } else { Self::default() }
    }
}

impl Serialize for Params {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|group| (&group.0, &group.1)))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_tree_comes_back_in_its_order_and_alike_groups_are_one() {
        let tree = |count: u32| json!({ "b": { "y": 1.5, "x": [1, 2] }, "a": { "n": count } });
        let [one, other] = [1, 2].map(|count| Params::from(tree(count)));
        assert_eq!(serde_json::to_string(&one).unwrap(), tree(1).to_string());
        assert_eq!(serde_json::from_value::<Params>(tree(1)).unwrap(), one);
        assert!(Arc::ptr_eq(&one.0[0], &other.0[0]));
        assert_ne!(one, other);
        assert_eq!(one.lookup("b.x"), Some(&json!([1, 2])));
        assert_eq!((one.lookup("b.z"), one.lookup("c"), one.lookup("")), (None, None, None));
        assert_eq!(Value::Object(one.to_map()), tree(1));
    }
}
