//! What `serve` knows of its slots.

use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;
use std::sync::{Mutex, MutexGuard, PoisonError};

use bagpipe_wire::from_map;

use super::figures::Figures;

/// The largest message of a slot's process, in bytes; it has about 700.
const MESSAGE: usize = 4096;
/// Messages that are read of one slot before the next one has its turn.
const MESSAGES: usize = 64;

/// The figures of all slots.
pub struct Gathered {
    slots: Mutex<Vec<Told>>,
}

/// What one slot's processes have told.
#[derive(Default)]
struct Told {
    /// From the one that runs.
    socket: Option<UnixDatagram>,
    latest: Figures,
    /// By those that have ended.
    before: Figures,
    deaths: u64,
}

/// All slots together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Total {
    pub slots: u64,
    pub busy: u64,
    /// Processes that ended unasked.
    pub deaths: u64,
    pub figures: Figures,
}

impl Gathered {
    pub fn new(slots: u32) -> Self {
        Self { slots: Mutex::new((0..slots).map(|_| Told::default()).collect()) }
    }

    /// The end on which a slot's new process tells its figures.
    pub fn listen_to(&self, slot: u32) -> std::io::Result<OwnedFd> {
        let (near, far) = UnixDatagram::pair()?;
        near.set_nonblocking(true)?;
        if let Some(told) = self.lock().get_mut(slot as usize) {
            told.socket = Some(near);
        }
        Ok(far.into())
    }

    /// Takes in what was told since.
    pub fn take_in(&self) {
        self.lock().iter_mut().for_each(Told::take_in);
    }

    /// A slot's process has ended; what it told stays counted.
    pub fn ended(&self, slot: u32) {
        if let Some(told) = self.lock().get_mut(slot as usize) {
            told.take_in();
            told.socket = None;
            told.deaths += 1;
            let last = std::mem::take(&mut told.latest).concluded();
            told.before.add(&last);
        }
    }

    /// Everything together.
    pub fn total(&self) -> Total {
        let slots = self.lock();
        let mut total = Total { slots: slots.len() as u64, ..Total::default() };
        for told in slots.iter() {
            total.busy += u64::from(told.latest.busy);
            total.deaths += told.deaths;
            total.figures.add(&told.before);
            total.figures.add(&told.latest);
        }
        total
    }

    /// Figures are whole between any two statements, whoever died holding them.
    fn lock(&self) -> MutexGuard<'_, Vec<Told>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Told {
    fn take_in(&mut self) {
        let Some(socket) = &self.socket else { return };
        let mut message = [0; MESSAGE];
        for _ in 0..MESSAGES {
            let Ok(length) = socket.recv(&mut message) else { return };
            // One that can't be read is followed by one that says the same and more.
            if let Ok(figures) = from_map(&message[..length]) {
                self.latest = figures;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bagpipe_wire::to_map;

    fn say(socket: &UnixDatagram, answered: u64, busy: bool) {
        let figures = Figures { answered, busy, ..Figures::default() };
        socket.send(&to_map(&figures).unwrap()).unwrap();
    }

    #[test]
    fn what_a_process_told_outlives_it() {
        let gathered = Gathered::new(2);
        let mut socket = UnixDatagram::from(gathered.listen_to(0).unwrap());
        let other = UnixDatagram::from(gathered.listen_to(1).unwrap());
        say(&other, 5, false);
        for death in 1..=3 {
            say(&socket, 1, false);
            socket.send(b"nonsense").unwrap();
            say(&socket, 2, true);
            gathered.take_in();
            let total = gathered.total();
            assert_eq!((total.slots, total.busy, total.deaths), (2, 1, death - 1));
            assert_eq!(total.figures.answered, 5 + 2 * death);
            say(&socket, 2, true);
            drop(socket);
            gathered.ended(0);
            let total = gathered.total();
            assert_eq!((total.busy, total.deaths, total.figures.abandoned), (0, death, death));
            assert_eq!(total.figures.answered, 5 + 2 * death);
            socket = UnixDatagram::from(gathered.listen_to(0).unwrap());
        }
    }

    #[test]
    fn a_slot_that_does_not_exist_is_nobodys() {
        let gathered = Gathered::new(1);
        gathered.listen_to(7).unwrap();
        gathered.ended(7);
        assert_eq!(gathered.total(), Total { slots: 1, ..Total::default() });
    }
}
