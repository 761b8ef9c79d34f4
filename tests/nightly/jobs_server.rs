//! A server on this machine that answers what jobs ask of GitHub and of GitLab: comments of one request.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard};

use serde_json::{Value, json};

/// Whose the token is.
pub const BOT: &str = "github-actions[bot]";
/// Comments on a page, as jobs ask for.
const PAGE: usize = 100;

#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum Mood {
    #[default]
    Well,
    /// A token that may read and not write.
    Forbids,
    Down,
    /// Every answer is JSON of no shape that is asked for.
    Garbles,
}

#[derive(Default)]
pub struct Served {
    pub mood: Mood,
    pub comments: Vec<Value>,
    /// Headers of all requests.
    pub headers: Vec<String>,
}

#[derive(Clone)]
pub struct Server {
    served: Arc<Mutex<Served>>,
    pub url: String,
}

impl Server {
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let server = Self { served: Arc::default(), url };
        let own = server.clone();
        std::thread::spawn(move || {
            listener.incoming().for_each(|stream| own.answer(&stream.unwrap()))
        });
        server
    }

    pub fn now(&self) -> MutexGuard<'_, Served> {
        self.served.lock().unwrap()
    }

    /// Adds a comment.
    pub fn say(&self, author: &str, body: &str) {
        self.now().add(author, body);
    }

    /// Texts of the comments by this author.
    pub fn comments_by(&self, author: &str) -> Vec<String> {
        let served = self.now();
        let own = served.comments.iter().filter(|comment| comment["user"]["login"] == author);
        own.map(|comment| comment["body"].as_str().unwrap().to_owned()).collect()
    }

    fn answer(&self, stream: &TcpStream) {
        let mut reader = BufReader::new(stream);
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") && reader.read_line(&mut head).unwrap() > 0 {}
        let lower = head.to_lowercase();
        let length = lower
            .split_once("content-length: ")
            .map_or(0, |(_, rest)| rest.lines().next().unwrap().trim().parse().unwrap());
        let mut body = vec![0; length];
        reader.read_exact(&mut body).unwrap();
        let mut words = head.split(' ');
        let (method, path) = (words.next().unwrap(), words.next().unwrap());
        let (status, reply) = self.now().reply(method, path, &body);
        self.now().headers.push(head.clone());
        let text = reply.to_string();
        let length = text.len();
        let mut stream = stream;
        // Who asked may be gone.
        let _ = write!(
            stream,
            "HTTP/1.1 {status} x\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{text}"
        );
    }
}

impl Served {
    fn add(&mut self, author: &str, body: &str) -> Value {
        let id = self.comments.len() + 1;
        let (user, by) = (json!({ "login": author }), json!({ "username": author }));
        self.comments.push(json!({ "id": id, "user": user, "author": by, "body": body }));
        self.comments[id - 1].clone()
    }

    fn reply(&mut self, method: &str, path: &str, body: &[u8]) -> (u32, Value) {
        let (path, query) = path.split_once('?').unwrap_or((path, ""));
        let request: Value = serde_json::from_slice(body).unwrap_or_default();
        let said = request["body"].as_str().unwrap_or_default();
        match (self.mood, method, path) {
            (Mood::Down, ..) => (503, json!("down")),
            (Mood::Garbles, ..) => (200, json!("words")),
            (Mood::Forbids, "POST" | "PATCH" | "PUT", _) => (403, json!({ "message": "no" })),
            // GitHub's job token has no user, and GitLab's access token has.
            (_, "GET", "/github/user") => (403, json!({ "message": "not accessible" })),
            (_, "GET", "/gitlab/job") => (200, json!({ "user": { "username": BOT } })),
            (_, "GET", "/gitlab/user") => (200, json!({ "username": BOT })),
            (
                _,
                "GET",
                "/github/repos/o/r/issues/7/comments" | "/gitlab/projects/1/merge_requests/7/notes",
            ) => {
                let page: usize = query.rsplit_once("page=").unwrap().1.parse().unwrap();
                let comments = self.comments.chunks(PAGE).nth(page - 1).unwrap_or_default();
                (200, json!(comments))
            }
            (
                _,
                "POST",
                "/github/repos/o/r/issues/7/comments" | "/gitlab/projects/1/merge_requests/7/notes",
            ) => (201, self.add(BOT, said)),
            (_, "PATCH" | "PUT", path) => {
                let known = [
                    "/github/repos/o/r/issues/comments/",
                    "/gitlab/projects/1/merge_requests/7/notes/",
                ];
                let id = known.iter().find_map(|known| path.strip_prefix(known)).unwrap();
                let comment = &mut self.comments[id.parse::<usize>().unwrap() - 1];
                comment["body"] = json!(said);
                (200, comment.clone())
            }
            (_, method, path) => panic!("{method} {path}"),
        }
    }
}
