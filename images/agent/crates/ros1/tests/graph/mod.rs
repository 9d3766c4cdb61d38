//! A real ROS graph for a test: Debian's rosmaster on a port of its own and nodes whose
//! output can be waited for. Everything it started is killed when it is dropped.
#![allow(dead_code, unused_imports)] // each test file uses its own part

mod ports;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use bagpipe_ros1::{Master, Rosmaster};
pub use ports::free_ports;

/// How long anything in a graph may take to appear on a loaded machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A master and the folder that its nodes may write to.
pub struct Graph {
    master: Option<Running>,
    /// The master's URI.
    pub uri: String,
    /// A folder of this graph's own.
    pub folder: PathBuf,
}

/// The process, or what serves in this one.
enum Running {
    OfDebian { _process: Process },
    Ours { _master: Rosmaster },
}

impl Graph {
    /// One with Debian's rosmaster, and one with ours.
    pub fn of_both(tmp: &str) -> [Graph; 2] {
        [Graph::start(tmp), Graph::of_ours(tmp)]
    }

    /// Serves a master of ours.
    pub fn of_ours(tmp: &str) -> Graph {
        let port = free_ports(1);
        let master = Rosmaster::serve((std::net::Ipv4Addr::LOCALHOST, port).into()).unwrap();
        let uri = format!("http://127.0.0.1:{port}/");
        assert_eq!(master.uri(), uri);
        let folder = Path::new(tmp).join(format!("graph-{}-{port}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Graph { master: Some(Running::Ours { _master: master }), uri, folder }
    }

    /// Starts a rosmaster and waits until it answers.
    pub fn start(tmp: &str) -> Graph {
        let port = free_ports(1);
        let uri = format!("http://127.0.0.1:{port}/");
        let folder = Path::new(tmp).join(format!("graph-{}-{port}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let mut graph = Graph { master: None, uri, folder };
        let port = port.to_string();
        let process = graph.spawn("/usr/bin/rosmaster", &["--core", "-p", &port]);
        graph.master = Some(Running::OfDebian { _process: process });
        let master = graph.client();
        wait_until("rosmaster answers", || master.get_pid().is_ok());
        graph
    }

    /// Ends the master at once and starts another one in its place, which knows nothing.
    pub fn restart_master(&mut self) {
        self.master.take();
        let port = self.uri.trim_end_matches('/').rsplit(':').next().unwrap().to_owned();
        let process = self.spawn("/usr/bin/rosmaster", &["--core", "-p", &port]);
        self.master = Some(Running::OfDebian { _process: process });
        let master = self.client();
        wait_until("rosmaster answers again", || master.get_pid().is_ok());
    }

    /// A client of the master.
    pub fn client(&self) -> Master {
        Master::new(&self.uri, "/test", Duration::from_secs(20)).unwrap()
    }

    /// A command in this graph's environment.
    pub fn command(&self, program: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        command
            .args(arguments)
            .current_dir(&self.folder)
            .env("ROS_MASTER_URI", &self.uri)
            .env("ROS_IP", "127.0.0.1")
            .env("ROS_HOME", &self.folder)
            .env("ROS_LOG_DIR", &self.folder)
            .env("PYTHONUNBUFFERED", "1")
            .env_remove("ROS_HOSTNAME")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Starts a node.
    pub fn spawn(&self, program: &str, arguments: &[&str]) -> Process {
        Process::start(self.command(program, arguments))
    }

    /// Starts a Python node of Debian's rospy.
    pub fn python(&self, script: &Path, arguments: &[&str]) -> Process {
        let mut all = vec![script.to_str().unwrap()];
        all.extend_from_slice(arguments);
        self.spawn("/usr/bin/python3", &all)
    }

    /// Runs a command to its end; its output.
    pub fn run(&self, program: &str, arguments: &[&str]) -> String {
        let output = self.command(program, arguments).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{program} {arguments:?}: {text}{errors}");
        text
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        self.master.take();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// A running process and the lines that it has printed.
pub struct Process {
    child: Child,
    lines: Arc<(Mutex<Vec<String>>, Condvar)>,
}

impl Process {
    fn start(mut command: Command) -> Process {
        let mut child = command.spawn().unwrap_or_else(|e| panic!("{command:?}: {e}"));
        let lines = Arc::new((Mutex::new(Vec::new()), Condvar::new()));
        collect(child.stdout.take().unwrap(), &lines);
        collect(child.stderr.take().unwrap(), &lines);
        Process { child, lines }
    }

    /// Waits for a line that contains `text`.
    pub fn wait_for(&self, text: &str) {
        let (lines, more) = &*self.lines;
        let lines = lines.lock().unwrap();
        let absent = |lines: &mut Vec<String>| !lines.iter().any(|line| line.contains(text));
        let (lines, timeout) = more.wait_timeout_while(lines, PATIENCE, absent).unwrap();
        assert!(!timeout.timed_out(), "no line with {text:?} in {lines:?}");
    }

    /// The number behind `word` in the last line that begins with it; 0 before the first.
    pub fn last_number(&self, word: &str) -> u64 {
        let lines = self.lines.0.lock().unwrap();
        let last = lines.iter().rev().find_map(|line| line.strip_prefix(word));
        last.map_or(0, |number| number.trim().parse().unwrap())
    }

    /// All lines so far.
    pub fn lines(&self) -> Vec<String> {
        self.lines.0.lock().unwrap().clone()
    }

    /// Whether it has ended.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn collect(
    stream: impl std::io::Read + Send + 'static,
    lines: &Arc<(Mutex<Vec<String>>, Condvar)>,
) {
    let lines = Arc::clone(lines);
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            lines.0.lock().unwrap().push(line);
            lines.1.notify_all();
        }
    });
}

/// Waits until a condition holds.
pub fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !condition() {
        assert!(Instant::now() < deadline, "waited in vain until {what}");
        std::thread::park_timeout(Duration::from_millis(10));
    }
}

/// Compiles a roscpp node once; the same source is not compiled again.
pub fn compile(tmp: &str, source: &Path) -> PathBuf {
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(|e| e.into_inner());
    let text = std::fs::read_to_string(source).unwrap();
    let binary = Path::new(tmp).join(source.file_stem().unwrap());
    let stamp = binary.with_extension("built-from");
    if std::fs::read_to_string(&stamp).is_ok_and(|built| built == text) {
        return binary;
    }
    let libraries = "-lroscpp -lrosconsole -lroscpp_serialization -lrostime -lxmlrpcpp \
                     -lcpp_common -lboost_system -lboost_thread -lpthread";
    let output = Command::new("g++")
        .args(["-O1", "-o"])
        .arg(&binary)
        .arg(source)
        .args(libraries.split_whitespace())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    std::fs::write(stamp, text).unwrap();
    binary
}
