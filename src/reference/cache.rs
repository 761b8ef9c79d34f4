//! Answers of references, kept on disk by their content: by everything that they are computed from, the code included.
//! A second run over the same scenes computes none of them again.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

/// Digest of the references' source files (`build.rs`): other code may give other answers.
const CODE: &str = env!("FATHOM_REFERENCES");

/// The content that an answer follows from, as it is being gathered.
#[derive(Clone)]
pub struct AnswerKey(Sha256);

impl AnswerKey {
    pub fn new(kind: &str) -> Self {
        Self(Sha256::new()).with(CODE.as_bytes()).with(kind.as_bytes())
    }

    /// Its length is part of it, so that no two lists of parts are alike.
    #[must_use]
    pub fn with(mut self, part: &[u8]) -> Self {
        self.0.update((part.len() as u64).to_le_bytes());
        self.0.update(part);
        self
    }

    pub fn digest(self) -> String {
        hex::encode(self.0.finalize())
    }
}

/// A folder of answers; none keeps nothing.
#[derive(Clone, Debug, Default)]
pub struct AnswerCache {
    pub folder: Option<PathBuf>,
}

impl AnswerCache {
    /// The answer to a question of this content. A file that is absent or cannot be read is made anew; one that cannot be
    /// written costs the next run its time, and nothing else.
    pub fn answer<T: Serialize + DeserializeOwned>(
        &self,
        content: AnswerKey,
        compute: impl FnOnce() -> T,
    ) -> T {
        let Some(folder) = &self.folder else { return compute() };
        let path = folder.join(content.digest() + ".json");
        let stored =
            std::fs::read(&path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        stored.unwrap_or_else(|| {
            let answer = compute();
            let _ = write(folder, &path, &answer);
            answer
        })
    }
}

/// All or nothing: another process may read it at the same time.
fn write(folder: &Path, path: &Path, answer: &impl Serialize) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut partial = tempfile::NamedTempFile::new_in(folder)?;
    partial.write_all(&serde_json::to_vec(answer)?)?;
    partial.persist(path)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content(parts: &[&str]) -> AnswerKey {
        parts.iter().fold(AnswerKey::new("test"), |content, part| content.with(part.as_bytes()))
    }

    #[test]
    fn an_answer_is_computed_once_for_each_content() {
        let folder = tempfile::tempdir().unwrap();
        let kept = AnswerCache { folder: Some(folder.path().join("new")) };
        let asked = |parts: &[&str], value: f64| kept.answer(content(parts), || vec![value]);
        assert_eq!(asked(&["a", "b"], 0.1), [0.1]);
        assert_eq!(asked(&["a", "b"], 2.0), [0.1], "kept, to the last bit");
        for other in [&["ab"][..], &["a", "b", ""], &["b", "a"]] {
            assert_eq!(asked(other, 3.0), [3.0], "{other:?}");
        }
        let none = AnswerCache::default();
        assert_eq!(none.answer(content(&["a", "b"]), || vec![4.0]), [4.0]);
    }

    #[test]
    fn a_damaged_file_is_made_anew_and_a_folder_that_is_none_costs_nothing_but_time() {
        let folder = tempfile::tempdir().unwrap();
        let kept = AnswerCache { folder: Some(folder.path().to_owned()) };
        kept.answer(content(&[]), || 1);
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        std::fs::write(&file, b"{").unwrap();
        assert_eq!(kept.answer(content(&[]), || 2), 2);
        assert_eq!(kept.answer(content(&[]), || 3), 2);
        let none = AnswerCache { folder: Some(file.join("below a file")) };
        assert_eq!(none.answer(content(&[]), || 4), 4);
    }
}
