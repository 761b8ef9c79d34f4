use std::fs;

use super::*;

fn folder() -> (tempfile::TempDir, Folder) {
    let out = tempfile::tempdir().unwrap();
    let folder = Folder::of(out.path(), 3);
    fs::create_dir_all(&folder.path).unwrap();
    (out, folder)
}

fn ended(folder: &Folder, status: &str) {
    fs::write(folder.beside(STATUS), status).unwrap();
}

#[test]
fn a_shard_that_is_done_is_not_submitted() {
    let (out, folder) = folder();
    assert!(Shard::new(Folder::of(out.path(), 3), 3).is_due(0));
    ended(&folder, "0\n");
    let shard = Shard::new(Folder::of(out.path(), 3), 3);
    assert!(!shard.is_due(2) && shard.is_over(2));
    assert_eq!(shard.failure(), None);
    // What is no status is none.
    ended(&folder, "zero\n");
    assert!(Shard::new(folder, 3).is_due(0));
}

#[test]
fn a_failed_shard_is_submitted_a_few_times_again() {
    let (_out, folder) = folder();
    ended(&folder, "2\n");
    fs::write(folder.beside(LOG), "begin\nerror: no adapter\n\n").unwrap();
    let mut shard = Shard::new(folder, 3);
    let mut times = 0;
    while shard.is_due(2) {
        shard.submitted();
        assert!(!shard.is_due(2) && !shard.is_over(2));
        let told = shard.look(&Queue::default(), &[]).unwrap();
        assert_eq!(told, "shard 3 ended with status 2: error: no adapter");
        times += 1;
    }
    assert_eq!(times, 3);
    assert!(shard.is_over(2));
    assert!(shard.failure().unwrap().contains("no adapter"));
}

/// Files of another machine may be seen late.
#[test]
fn a_task_that_is_gone_is_given_time_to_show_its_status() {
    let (_out, folder) = folder();
    let mut shard = Shard::new(folder, 3);
    shard.submitted();
    assert_eq!(shard.look(&Queue::default(), &[]), None);
    assert!(matches!(shard.state, State::Gone(_)), "{:?}", shard.state);
    ended(&shard.folder, "1\n");
    assert!(shard.look(&Queue::default(), &[]).unwrap().contains("cells that failed"));
    shard.submitted();
    fs::remove_file(shard.folder.beside(STATUS)).unwrap();
    shard.state = State::Gone(Instant::now().checked_sub(2 * GRACE).unwrap());
    assert_eq!(
        shard.look(&Queue::default(), &[]).as_deref(),
        Some("shard 3 was killed before it ended")
    );
    assert_eq!(shard.state, State::Over(Ending::Lost));
}

#[test]
fn cells_are_counted_as_they_come() {
    let (_out, folder) = folder();
    let path = folder.path.join(RECORDS);
    let mut shard = Shard::new(folder, 3);
    assert_eq!(shard.count(), (0, None));
    let cell = r#"{"record":"cell","experiment":"a"}"#;
    fs::write(&path, format!("{{\"record\":\"end\"}}\n{cell}\n{cell}\n{}", &cell[..9])).unwrap();
    assert_eq!(shard.count().0, 2);
    assert_eq!(shard.count().0, 2);
    fs::write(&path, format!("{{\"record\":\"end\"}}\n{cell}\n{cell}\n{cell}\n")).unwrap();
    assert_eq!(shard.count().0, 3);
    // A file that was begun anew.
    fs::write(&path, format!("{cell}\n")).unwrap();
    assert_eq!(shard.count().0, 1);
}

#[cfg(unix)]
#[test]
fn no_link_and_no_pipe_of_the_folder_is_opened() {
    use std::os::unix::fs::symlink;
    use std::sync::mpsc;

    let (out, folder) = folder();
    let elsewhere = tempfile::tempdir().unwrap();
    let header = r#"{"record":"run"}"#;
    for (name, text) in [(RECORDS, header), ("3.status", "0"), ("3.log", "a log")] {
        fs::write(elsewhere.path().join(name), text).unwrap();
    }
    let names = [folder.path.join(RECORDS), folder.beside(STATUS), folder.beside(LOG)];
    let link = |path: &Path| {
        symlink(elsewhere.path().join(path.file_name().unwrap()), path).unwrap();
    };
    let pipe = |path: &Path| {
        assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    };
    for make in [&link as &dyn Fn(&Path), &pipe] {
        names.iter().for_each(|path| make(path));
        let ((done, read), path) = (mpsc::channel(), folder.path.clone());
        std::thread::spawn(move || {
            let folder = Folder { path };
            let told = (folder.header(), folder.status(), folder.last_line());
            done.send((told, Shard::new(folder, 3).count()))
        });
        // Far longer than it takes: only a hang ends so.
        let (told, counted) = read.recv_timeout(Duration::from_secs(300)).expect("no hang");
        assert_eq!((told, counted), ((None, None, None), (0, None)));
        names.iter().for_each(|path| fs::remove_file(path).unwrap());
    }
    Folder::prepare(out.path(), 3).unwrap();
    fs::remove_dir(&folder.path).unwrap();
    symlink(elsewhere.path(), &folder.path).unwrap();
    let told = Folder::prepare(out.path(), 3).unwrap_err().to_string();
    assert!(told.contains("`3` is a symbolic link"), "{told}");
    Folder::prepare(out.path(), 2).unwrap();
    fs::remove_file(&folder.path).unwrap();
    fs::remove_dir(out.path().join(SHARDS)).unwrap();
    symlink(elsewhere.path(), out.path().join(SHARDS)).unwrap();
    let told = Folder::prepare(out.path(), 3).unwrap_err().to_string();
    assert!(told.contains("`shards` is a symbolic link"), "{told}");
    assert_eq!(fs::read_dir(elsewhere.path()).unwrap().count(), 3);
}
