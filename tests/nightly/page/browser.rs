//! A headless Chromium, driven by WebDriver.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};
use tempfile::TempDir;

/// Chromium without anything that asks the network, and with its sandbox off, as a container has none. WebGPU is SwiftShader's.
const ARGUMENTS: [&str; 11] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
];

/// Ends a script that waits for what never comes, and decides nothing: the longest here takes seconds.
const PATIENCE: Duration = Duration::from_secs(600);

/// How a page is shown.
#[derive(Clone, Copy, Debug)]
pub struct Display {
    pub width_px: u32,
    pub dark: bool,
    pub print: bool,
}

pub const WIDE: Display = Display { width_px: 1400, dark: false, print: false };
pub const NARROW: Display = Display { width_px: 380, ..WIDE };

pub struct Browser {
    service: Service,
    /// Path of the session, which each command's path begins with.
    session: String,
    _profile: TempDir,
}

impl Browser {
    pub fn open() -> Browser {
        let service = Service::start();
        let profile = tempfile::tempdir().unwrap();
        let folder = format!("--user-data-dir={}", profile.path().display());
        let arguments: Vec<&str> = ARGUMENTS.into_iter().chain([folder.as_str()]).collect();
        let wanted = json!({
            "browserName": "chrome",
            "goog:chromeOptions": { "args": arguments },
            "goog:loggingPrefs": { "browser": "ALL" },
        });
        let wanted = json!({ "capabilities": { "alwaysMatch": wanted } });
        let opened = service.ask("POST", "/session", &wanted);
        let opened =
            opened.unwrap_or_else(|told| panic!("chromedriver starts no Chromium: {told}"));
        let session = format!("/session/{}", opened["sessionId"].as_str().unwrap());
        let browser = Browser { service, session, _profile: profile };
        browser.command("/timeouts", json!({ "script": PATIENCE.as_millis() as u64 }));
        browser
    }

    /// A command of the session.
    fn command(&self, path: &str, parameters: Value) -> Value {
        let answer = self.service.ask("POST", &format!("{}{path}", self.session), &parameters);
        answer.unwrap_or_else(|error| panic!("{error}\n{parameters}"))
    }

    /// Opens a file and waits until it is loaded.
    pub fn show(&self, page: &Path, display: Display) {
        self.show_at(page, "", display);
    }

    /// The same with what follows the file's name in the address.
    pub fn show_at(&self, page: &Path, place: &str, display: Display) {
        self.set(display);
        // A change of the place alone would load nothing.
        self.command("/url", json!({ "url": "about:blank" }));
        self.command("/url", json!({ "url": format!("file://{}{place}", page.display()) }));
    }

    pub fn set(&self, Display { width_px, dark, print }: Display) {
        let size =
            json!({ "width": width_px, "height": 1000, "deviceScaleFactor": 1, "mobile": false });
        self.devtools("Emulation.setDeviceMetricsOverride", size);
        let scheme = if dark { "dark" } else { "light" };
        let media = json!({
            "media": if print { "print" } else { "screen" },
            "features": [{ "name": "prefers-color-scheme", "value": scheme }],
        });
        self.devtools("Emulation.setEmulatedMedia", media);
    }

    pub fn devtools(&self, command: &str, parameters: Value) -> Value {
        self.command("/goog/cdp/execute", json!({ "cmd": command, "params": parameters }))
    }

    /// What a script returns that runs in the page.
    pub fn eval(&self, script: &str) -> Value {
        self.command("/execute/sync", json!({ "script": script, "args": [] }))
    }

    /// The same of a script that ends with a call of its last argument.
    pub fn eval_later(&self, script: &str) -> Value {
        self.command("/execute/async", json!({ "script": script, "args": [] }))
    }

    /// Messages of the console since the last call: errors of scripts, refused resources, broken policies.
    pub fn console(&self) -> Vec<String> {
        let log = self.command("/se/log", json!({ "type": "browser" }));
        log.as_array().unwrap().iter().map(Value::to_string).collect()
    }

    pub fn close(self) {
        self.service.ask("DELETE", &self.session, &json!({})).unwrap();
    }
}

/// A ChromeDriver of the test's own.
struct Service {
    process: Child,
    port: u16,
}

impl Service {
    fn start() -> Service {
        let mut driver = Command::new("chromedriver");
        let driver = driver.arg("--port=0").stdout(Stdio::piped()).stderr(Stdio::null());
        let mut process = driver.spawn().expect("`make test-all` installs chromium-driver");
        let port = port(&mut process);
        Service { process, port }
    }

    /// A request of WebDriver, and the value of its answer; or the error.
    fn ask(&self, method: &str, path: &str, parameters: &Value) -> Result<Value, String> {
        let body = parameters.to_string();
        let length = body.len();
        let mut connection = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let request = format!(
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\
             Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n{body}"
        );
        connection.write_all(request.as_bytes()).unwrap();
        let mut answer = BufReader::new(connection);
        let head: Vec<String> = answer
            .by_ref()
            .lines()
            .map(Result::unwrap)
            .take_while(|line| !line.is_empty())
            .collect();
        let header = |line: &String| {
            let (name, value) = line.split_once(':')?;
            name.eq_ignore_ascii_case("content-length").then(|| value.trim().parse().unwrap())
        };
        // ChromeDriver leaves the connection open.
        let length = head.iter().find_map(header).expect("the answer's length");
        let mut answer: Value = serde_json::from_reader(answer.take(length)).unwrap();
        let value = answer["value"].take();
        let is_done = head[0].split(' ').nth(1) == Some("200");
        if is_done { Ok(value) } else { Err(value.to_string()) }
    }
}

/// After a failed test too: ChromeDriver ends its browser when it is asked to end.
impl Drop for Service {
    fn drop(&mut self) {
        let asked = Command::new("kill").arg(self.process.id().to_string()).status();
        if asked.is_ok_and(|status| status.success()) {
            let _ = self.process.wait();
        }
    }
}

/// ChromeDriver tells on standard output which port it took.
fn port(service: &mut Child) -> u16 {
    let lines = BufReader::new(service.stdout.take().unwrap()).lines();
    let answer = lines.map_while(Result::ok).find(|line| line.contains("successfully on port"));
    let answer = answer.expect("chromedriver tells its port");
    let (_, port) = answer.trim_end_matches('.').rsplit_once(' ').unwrap();
    port.parse().unwrap_or_else(|_| panic!("no port: {answer}"))
}

/// The source of axe-core.
pub fn axe() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/target/npm/node_modules/axe-core/axe.min.js");
    std::fs::read_to_string(path).expect("`make test-all` installs axe-core by npm")
}
