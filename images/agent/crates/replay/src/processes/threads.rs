//! What the kernel says of threads: how much they wanted a processor, and what they wait for.
//! Pure: the texts come from elsewhere.

/// The numbers of the system calls that are distinguished.
#[cfg(target_arch = "x86_64")]
mod calls {
    pub(super) const RECEIVE: [u64; 2] = [45, 0]; // recvfrom, read
    pub(super) const SLEEP: [u64; 2] = [35, 230]; // nanosleep, clock_nanosleep
}
#[cfg(not(target_arch = "x86_64"))]
mod calls {
    // The generic table, which aarch64 and riscv64 have.
    pub(super) const RECEIVE: [u64; 2] = [207, 63];
    pub(super) const SLEEP: [u64; 2] = [101, 115];
}

/// What a thread waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Waits {
    /// Bytes of this file descriptor.
    Bytes(u64),
    /// A time.
    Time,
    /// A processor, unless it has one.
    Processor,
    /// What a disk has to bring before it can go on.
    Disk,
    /// That somebody lets it go on, as behind a signal or for a debugger.
    Leave,
    /// Something else.
    Else,
}

impl Waits {
    /// Whether it goes on as soon as the machine lets it.
    pub(crate) fn is_of_the_machine(self) -> bool {
        matches!(self, Waits::Processor | Waits::Disk)
    }

    /// Whether it is in the midst of something, though it takes no processor.
    pub(crate) fn is_held_up(self) -> bool {
        matches!(self, Waits::Disk | Waits::Leave)
    }
}

/// What a thread has had and wanted of processors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Demand {
    /// Nanoseconds that it ran or would have run, had there been a processor.
    pub(crate) nanoseconds: u64,
    /// Nanoseconds of these in which it could have run and had no processor.
    pub(crate) waited: u64,
    /// How often it has been put on one.
    pub(crate) turns: u64,
}

/// Reads /proc/PID/task/TID/schedstat: time run, time waited to run, turns.
pub(crate) fn demand(schedstat: &str) -> Option<Demand> {
    let mut numbers = schedstat.split_ascii_whitespace().map(|word| word.parse::<u64>().ok());
    let (ran, waited, turns) = (numbers.next()??, numbers.next()??, numbers.next()??);
    Some(Demand { nanoseconds: ran.saturating_add(waited), waited, turns })
}

/// What a thread waits for, by its `syscall` and by its `stat` (proc(5)), of which the second was read later: who slept
/// by the first and runs by the second has something to do.
pub(crate) fn waits(syscall: &str, stat: &str) -> Option<Waits> {
    // The name, in brackets, may have any letters.
    match stat.rsplit(')').next().and_then(|rest| rest.trim_start().chars().next()) {
        Some('D') => Some(Waits::Disk),
        Some('R') => Some(Waits::Processor),
        Some('T' | 't') => Some(Waits::Leave),
        _ => in_call(syscall),
    }
}

/// Reads /proc/PID/task/TID/syscall: a number and its arguments in hexadecimal, or `running`.
fn in_call(syscall: &str) -> Option<Waits> {
    let mut words = syscall.split_ascii_whitespace();
    let first = words.next()?;
    if first == "running" {
        return Some(Waits::Processor);
    }
    let Ok(number) = first.parse::<u64>() else { return Some(Waits::Else) };
    if calls::SLEEP.contains(&number) {
        return Some(Waits::Time);
    }
    if !calls::RECEIVE.contains(&number) {
        return Some(Waits::Else);
    }
    let descriptor = u64::from_str_radix(words.next()?.strip_prefix("0x")?, 16).ok()?;
    Some(Waits::Bytes(descriptor))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_kernels_words_on_threads_are_understood() {
        let ran = Demand { nanoseconds: 1_500, waited: 500, turns: 7 };
        assert_eq!(demand("1000 500 7\n"), Some(ran));
        assert_eq!(demand("1000 500\n"), None);
        assert_eq!(in_call("running\n"), Some(Waits::Processor));
        assert_eq!(in_call("-1 0x7ffd 0x7f08\n"), Some(Waits::Else));
        assert_eq!(in_call(""), None);
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn a_thread_that_waits_for_bytes_names_the_descriptor() {
        assert_eq!(
            in_call("45 0x1f 0x55aa 0x10000 0x0 0x0 0x0 0x7ff 0x7f"),
            Some(Waits::Bytes(31))
        );
        assert_eq!(in_call("230 0x1 0x0 0x7ff 0x0 0x0 0x0 0x7 0x7"), Some(Waits::Time));
        assert_eq!(in_call("202 0x1 0x0"), Some(Waits::Else));
        assert_eq!(in_call("45"), None);
    }

    #[test]
    fn a_threads_later_state_overrules_the_call_that_it_was_in() {
        let disk = "-1 0x7ffd 0x7f08\n";
        assert_eq!(waits(disk, "7 (py) S) D 1 7 7 0"), Some(Waits::Disk));
        assert_eq!(waits(disk, "7 (D D) S 1 7 7 0"), Some(Waits::Else));
        assert_eq!(waits(disk, "7 (a) R 1 7 7 0"), Some(Waits::Processor));
        assert_eq!(waits("running", "7 (R) S 1 7 7 0"), Some(Waits::Processor));
        assert_eq!(waits("202 0x1 0x0", "7 (S) T 1 7 7 0"), Some(Waits::Leave));
        assert_eq!(waits("202 0x1 0x0", "7 (S) t 1 7 7 0"), Some(Waits::Leave));
        assert_eq!(waits(disk, ""), Some(Waits::Else));
        assert_eq!(waits("", "7 (py) D 1 7 7 0"), Some(Waits::Disk));
        assert_eq!(waits("", "7 (py) S 1 7 7 0"), None);
        assert_eq!(waits("", ""), None);
    }

    proptest! {
        #[test]
        fn no_text_makes_the_readers_panic(text in "(?s).{0,100}") {
            demand(&text);
            waits(&text, &text);
            in_call(&text);
        }
    }
}
