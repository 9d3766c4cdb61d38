//! Where things lie on the shared volume.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use bagpipe_wire::fifo;

/// Between two looks for slots that do not listen yet: they are made in milliseconds.
const LOOK: Duration = Duration::from_millis(5);

/// The shared volume.
#[derive(Debug, Clone)]
pub struct Shared {
    slots: PathBuf,
}

/// One slot's folder on it.
#[derive(Debug, Clone)]
pub struct SlotFolder {
    folder: PathBuf,
}

impl Shared {
    pub fn new(folder: &Path) -> Self {
        Self { slots: folder.join("slots") }
    }

    pub fn slot(&self, number: u32) -> SlotFolder {
        SlotFolder { folder: self.slots.join(number.to_string()) }
    }

    /// Makes every slot's folder, pipes and lease, and then says how many there are.
    pub fn make(&self, slots: u32) -> Result<(), String> {
        for number in 0..slots {
            self.slot(number).make()?;
        }
        let serving = self.serving();
        fs::write(&serving, format!("{slots}\n")).map_err(|error| unwritable(&serving, &error))
    }

    /// Fails unless every slot listens before so much time is over.
    pub fn await_ready(&self, patience: Duration) -> Result<(), String> {
        let began = Instant::now();
        loop {
            match self.check_ready() {
                Err(_) if began.elapsed() < patience => thread::sleep(LOOK),
                found => return found,
            }
        }
    }

    /// Fails unless every slot listens.
    fn check_ready(&self) -> Result<(), String> {
        let serving = self.serving();
        let text = fs::read_to_string(&serving)
            .map_err(|error| format!("not serving yet: {} ({error})", serving.display()))?;
        let slots: u32 = text
            .trim()
            .parse()
            .map_err(|_| format!("{} holds no number of slots", serving.display()))?;
        match (0..slots).find(|number| !self.slot(*number).is_listening()) {
            None => Ok(()),
            Some(number) => Err(format!("slot {number} does not listen yet")),
        }
    }

    fn serving(&self) -> PathBuf {
        self.slots.join("serving")
    }
}

impl SlotFolder {
    pub fn path(&self) -> &Path {
        &self.folder
    }

    pub fn requests(&self) -> PathBuf {
        self.folder.join("to-agent")
    }

    pub fn answers(&self) -> PathBuf {
        self.folder.join("from-agent")
    }

    /// Says that this process listens.
    pub fn note_listening(&self) -> Result<(), String> {
        let path = self.listening();
        fs::write(&path, std::process::id().to_string()).map_err(|error| unwritable(&path, &error))
    }

    fn make(&self) -> Result<(), String> {
        fs::create_dir_all(&self.folder).map_err(|error| unwritable(&self.folder, &error))?;
        // Spark's workers run as another user and must reach the pipes.
        for folder in self.folder.ancestors().take(2) {
            fs::set_permissions(folder, Permissions::from_mode(0o755))
                .map_err(|error| unwritable(folder, &error))?;
        }
        // A container that was restarted finds its predecessor's note.
        if self.listening().exists() {
            fs::remove_file(self.listening())
                .map_err(|error| unwritable(&self.listening(), &error))?;
        }
        for pipe in [self.requests(), self.answers()] {
            fifo::make(&pipe).map_err(|error| {
                format!("{} (is this a file system with FIFOs?)", unwritable(&pipe, &error))
            })?;
        }
        let lease = self.folder.join("lease");
        fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&lease)
            .and_then(|_| fifo::open_to_all(&lease))
            .map_err(|error| unwritable(&lease, &error))
    }

    /// True when the process that noted itself here is still a slot's: its number may have
    /// gone to another one since.
    fn is_listening(&self) -> bool {
        fs::read_to_string(self.listening())
            .and_then(|pid| fs::read(Path::new("/proc").join(pid).join("cmdline")))
            .is_ok_and(|line| line.split(|byte| *byte == 0).nth(1) == Some(b"slot"))
    }

    fn listening(&self) -> PathBuf {
        self.folder.join("listening")
    }
}

fn unwritable(path: &Path, error: &std::io::Error) -> String {
    format!("cannot write {}: {error}", path.display())
}
