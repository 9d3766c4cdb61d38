//! A slot's process tells its figures to `serve`.

use std::os::fd::AsFd;
use std::os::unix::net::UnixDatagram;
use std::sync::Arc;
use std::time::Duration;

use bagpipe_wire::to_map;

use super::figures::{Figures, SlotFigures};

/// How often a running case's figures are told.
const ROUND: Duration = Duration::from_millis(250);

/// Tells until the process ends; the last time when it is dropped.
pub struct Teller {
    socket: Arc<UnixDatagram>,
    figures: Arc<SlotFigures>,
}

impl Teller {
    /// Begins to tell on stdin, a socket that `serve` has the other end of.
    ///
    /// # Errors
    /// It is none, or there is no thread to be had.
    pub fn start(figures: &Arc<SlotFigures>) -> std::io::Result<Teller> {
        let socket = UnixDatagram::from(std::io::stdin().as_fd().try_clone_to_owned()?);
        Teller::tell_on(socket, figures)
    }

    fn tell_on(socket: UnixDatagram, figures: &Arc<SlotFigures>) -> std::io::Result<Teller> {
        // A case never waits for `serve`.
        socket.set_nonblocking(true)?;
        let teller = Teller { socket: Arc::new(socket), figures: Arc::clone(figures) };
        let (socket, figures) = (Arc::clone(&teller.socket), Arc::clone(figures));
        std::thread::Builder::new()
            .name("teller".to_owned())
            .spawn(move || keep_telling(&socket, &figures))?;
        Ok(teller)
    }
}

impl Drop for Teller {
    fn drop(&mut self) {
        tell(&self.socket, &self.figures.read());
    }
}

fn keep_telling(socket: &UnixDatagram, figures: &SlotFigures) {
    let mut told = Figures::default();
    loop {
        let now = figures.read();
        let late = now != told && !tell(socket, &now);
        let busy = now.busy;
        if !late {
            told = now;
        }
        // An idle slot has nothing new to tell, so its thread sleeps.
        figures.await_stir((busy || late).then_some(ROUND));
    }
}

/// All figures in one message, so that one that is lost costs nothing but time; `false` if this
/// one is.
fn tell(socket: &UnixDatagram, figures: &Figures) -> bool {
    to_map(figures).is_ok_and(|message| socket.send(&message).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_listener_that_sleeps_holds_nothing_up_and_gets_the_last_word() {
        let (near, far) = UnixDatagram::pair().unwrap();
        far.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let figures = Arc::new(SlotFigures::default());
        let teller = Teller::tell_on(near, &figures).unwrap();
        // More cases than a socket holds messages.
        for _ in 0..5000 {
            figures.begin(4096);
            figures.end(&Ok(()));
        }
        let mut buffer = [0; 4096];
        let mut read = || {
            let length = far.recv(&mut buffer).unwrap();
            assert!(length < 2048, "{length}");
            bagpipe_wire::from_map::<Figures>(&buffer[..length]).unwrap()
        };
        while read().answered < 5000 {}
        figures.begin(4096);
        while !read().busy {}
        drop(teller);
    }
}
