//! A headless Chromium, driven by WebDriver.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};
use tempfile::TempDir;
use thirtyfour::LoggingPrefsLogLevel;
use thirtyfour::prelude::*;

/// Chromium without anything that asks the network, and with its sandbox off, as a container has none.
const ARGUMENTS: [&str; 9] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
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
    pub driver: WebDriver,
    service: Child,
    _profile: TempDir,
}

impl Browser {
    /// None, with a printed reason, where Chromium or ChromeDriver is not installed.
    pub async fn open() -> Option<Browser> {
        let service = Command::new("chromedriver")
            .arg("--port=0")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut service) = service else {
            println!("skipped: no chromedriver; install the packages chromium and chromium-driver");
            return None;
        };
        let port = port(&mut service);
        let profile = tempfile::tempdir().unwrap();
        let mut wanted = DesiredCapabilities::chrome();
        for argument in ARGUMENTS {
            wanted.add_arg(argument).unwrap();
        }
        wanted.add_arg(&format!("--user-data-dir={}", profile.path().display())).unwrap();
        wanted.set_logging_prefs("browser", LoggingPrefsLogLevel::All).unwrap();
        let driver = WebDriver::new(format!("http://127.0.0.1:{port}"), wanted).await;
        let driver =
            driver.unwrap_or_else(|error| panic!("chromedriver starts no Chromium: {error}"));
        driver.set_script_timeout(PATIENCE).await.unwrap();
        Some(Browser { driver, service, _profile: profile })
    }

    /// Opens a file and waits until it is loaded.
    pub async fn show(&self, page: &Path, display: Display) {
        self.set(display).await;
        self.driver.goto(format!("file://{}", page.display())).await.unwrap();
    }

    pub async fn set(&self, Display { width_px, dark, print }: Display) {
        let size =
            json!({ "width": width_px, "height": 1000, "deviceScaleFactor": 1, "mobile": false });
        self.devtools("Emulation.setDeviceMetricsOverride", size).await;
        let scheme = if dark { "dark" } else { "light" };
        let media = json!({
            "media": if print { "print" } else { "screen" },
            "features": [{ "name": "prefers-color-scheme", "value": scheme }],
        });
        self.devtools("Emulation.setEmulatedMedia", media).await;
    }

    pub async fn devtools(&self, command: &str, parameters: Value) -> Value {
        self.driver.cdp().send_raw(command, parameters).await.unwrap()
    }

    /// What a script returns that runs in the page.
    pub async fn eval(&self, script: &str) -> Value {
        let result = self.driver.execute(script, vec![]).await;
        result.unwrap_or_else(|error| panic!("{error}\n{script}")).json().clone()
    }

    /// The same of a script that ends with a call of its last argument.
    pub async fn eval_later(&self, script: &str) -> Value {
        let result = self.driver.execute_async(script, vec![]).await;
        result.unwrap_or_else(|error| panic!("{error}\n{script}")).json().clone()
    }

    /// Messages of the console since the last call: errors of scripts, refused resources, broken policies.
    pub async fn console(&self) -> Vec<String> {
        let log = self.driver.browser_log().await.unwrap();
        log.into_iter().map(|entry| format!("{entry:?}")).collect()
    }

    pub async fn close(self) {
        self.driver.clone().quit().await.unwrap();
    }
}

/// After a failed test too: ChromeDriver ends its browser when it is asked to end.
impl Drop for Browser {
    fn drop(&mut self) {
        let asked = Command::new("kill").arg(self.service.id().to_string()).status();
        if asked.is_ok_and(|status| status.success()) {
            let _ = self.service.wait();
        }
    }
}

/// ChromeDriver tells on standard output which port it took.
fn port(service: &mut Child) -> u16 {
    let lines = BufReader::new(service.stdout.take().unwrap()).lines();
    let told = lines.map_while(Result::ok).find(|line| line.contains("successfully on port"));
    let told = told.expect("chromedriver tells its port");
    let digits: String = told
        .chars()
        .rev()
        .skip_while(|c| !c.is_ascii_digit())
        .take_while(char::is_ascii_digit)
        .collect();
    digits.chars().rev().collect::<String>().parse().unwrap()
}

/// The source of axe-core; none, with a printed reason, where it is not installed.
pub fn axe() -> Option<String> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("target/npm/node_modules/axe-core/axe.min.js");
    match std::fs::read_to_string(&path) {
        Ok(source) => Some(source),
        Err(_) => {
            println!("skipped: no axe-core in target/npm; `make setup-test` installs it by npm");
            None
        }
    }
}
