use std::fs;

use super::*;

fn folder() -> (tempfile::TempDir, Folder) {
    let out = tempfile::tempdir().unwrap();
    let folder = Folder::of(out.path(), 3);
    fs::create_dir_all(folder.path()).unwrap();
    (out, folder)
}

fn beside(folder: &Folder, ending: &str) -> PathBuf {
    folder.out.join(folder.beside(ending))
}

fn ended(folder: &Folder, status: &str, job: u64) {
    fs::write(beside(folder, STATUS), format!("{status} {job}\n")).unwrap();
}

#[test]
fn a_shard_that_is_done_is_not_submitted() {
    let (out, folder) = folder();
    assert!(Shard::new(Folder::of(out.path(), 3), 3).is_due(0));
    ended(&folder, "0", 7);
    let shard = Shard::new(Folder::of(out.path(), 3), 3);
    assert!(!shard.is_due(2) && shard.is_over(2));
    assert_eq!(shard.failure(), None);
    // What is no status is none.
    ended(&folder, "zero", 7);
    assert!(Shard::new(Folder::of(out.path(), 3), 3).is_due(0));
    fs::write(beside(&folder, STATUS), "0\n").unwrap();
    assert!(Shard::new(folder, 3).is_due(0));
}

#[test]
fn a_failed_shard_is_submitted_a_few_times_again() {
    let (_out, folder) = folder();
    ended(&folder, "2", 1);
    fs::write(beside(&folder, LOG), "begin\nerror: no adapter\n\n").unwrap();
    let mut shard = Shard::new(folder, 3);
    let mut times = 0;
    while shard.is_due(2) {
        times += 1;
        shard.submitted(JobId(times));
        assert!(!shard.is_due(2) && !shard.is_over(2));
        ended(&shard.folder, "2", times);
        let told = shard.look(&Queue::default()).unwrap();
        assert_eq!(told, "shard 3 ended with status 2: error: no adapter");
    }
    assert_eq!(times, 3);
    assert!(shard.is_over(2));
    assert!(shard.failure().unwrap().contains("no adapter"));
}

fn gone_for(shard: &mut Shard, time: Duration) {
    shard.state = State::Gone(Instant::now().checked_sub(time).unwrap());
}

/// Files of another machine may be seen late.
#[test]
fn a_task_that_is_gone_is_given_time_to_show_its_status() {
    let (_out, folder) = folder();
    let mut shard = Shard::new(folder, 3);
    shard.submitted(JobId(1));
    assert_eq!(shard.look(&Queue::default()), None);
    assert!(matches!(shard.state, State::Gone(_)), "{:?}", shard.state);
    ended(&shard.folder, "1", 1);
    assert!(shard.look(&Queue::default()).unwrap().contains("cells that failed"));
    shard.submitted(JobId(2));
    shard.is_seen = true;
    gone_for(&mut shard, 2 * GRACE);
    let told = shard.look(&Queue::default());
    assert_eq!(told.as_deref(), Some("shard 3 was killed before it ended"));
    assert_eq!(shard.state, State::Over(Ending::Lost));
}

/// The queue may show a job late, while the status of the job before is still there.
#[test]
fn an_earlier_jobs_status_and_a_late_queue_end_no_shard() {
    let (_out, folder) = folder();
    ended(&folder, "2", 1);
    let mut shard = Shard::new(folder, 3);
    shard.submitted(JobId(2));
    assert_eq!(shard.look(&Queue::default()), None);
    gone_for(&mut shard, 2 * GRACE);
    assert_eq!(shard.look(&Queue::default()), None);
    assert!(!shard.is_due(9) && !shard.is_over(9));
    gone_for(&mut shard, 2 * UNSEEN_GRACE);
    shard.look(&Queue::default()).unwrap();
    assert_eq!(shard.state, State::Over(Ending::Lost));
}

#[test]
fn cells_are_counted_as_they_come() {
    let (_out, folder) = folder();
    let path = folder.path().join(RECORDS);
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
    for (name, text) in [(RECORDS, header), ("3.status", "0 12"), ("3.log", "a log")] {
        fs::write(elsewhere.path().join(name), text).unwrap();
    }
    let names = [folder.path().join(RECORDS), beside(&folder, STATUS), beside(&folder, LOG)];
    let link = |path: &Path| {
        symlink(elsewhere.path().join(path.file_name().unwrap()), path).unwrap();
    };
    let pipe = |path: &Path| {
        assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    };
    for make in [&link as &dyn Fn(&Path), &pipe] {
        names.iter().for_each(|path| make(path));
        let ((done, read), out) = (mpsc::channel(), folder.out.clone());
        std::thread::spawn(move || {
            let folder = Folder::of(&out, 3);
            let told = (folder.header(), folder.status(None), folder.last_line());
            done.send((told, Shard::new(folder, 3).count())).is_ok()
        });
        // Far longer than it takes: only a hang ends so.
        let (told, counted) = read.recv_timeout(Duration::from_secs(300)).expect("no hang");
        assert_eq!((told, counted), ((None, None, None), (0, None)));
        names.iter().for_each(|path| fs::remove_file(path).unwrap());
    }
    Folder::prepare(out.path(), 3).unwrap();
    fs::remove_dir(folder.path()).unwrap();
    symlink(elsewhere.path(), folder.path()).unwrap();
    let told = Folder::prepare(out.path(), 3).unwrap_err().to_string();
    assert!(told.contains("`3` is a symbolic link"), "{told}");
    Folder::prepare(out.path(), 2).unwrap();
    fs::remove_file(folder.path()).unwrap();
    fs::remove_dir(out.path().join(SHARDS)).unwrap();
    symlink(elsewhere.path(), out.path().join(SHARDS)).unwrap();
    let told = Folder::prepare(out.path(), 3).unwrap_err().to_string();
    assert!(told.contains("`shards` is a symbolic link"), "{told}");
    assert_eq!(fs::read_dir(elsewhere.path()).unwrap().count(), 3);
}
