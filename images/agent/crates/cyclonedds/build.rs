//! Builds Cyclone DDS with the C compiler that links Rust: no CMake, no generator.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// `NDEBUG` changes structures: whoever uses the headers defines it as well.
const FLAGS: [&str; 7] =
    ["-std=gnu11", "-O2", "-DNDEBUG", "-fPIE", "-ffunction-sections", "-fdata-sections", "-w"];
const INCLUDED: [&str; 9] = [
    "ddsrt/include",
    "core/cdr/include",
    "core/ddsi/include",
    "core/ddsc/include",
    "ddsrt/src",
    "core/ddsi/src",
    "core/ddsc/src",
    "security/api/include",
    "security/core/include",
];
/// The runtime's parts for this system; `src` has those of others beside them.
const RUNTIME: &str = "atomics avl bits bswap cdtors circlist dynlib environ expand_vars fibheap \
    hopscotch ifaddrs io log machineid md5 mh3 random retcode sockets string strtod strtol threads \
    time xmlparser environ/posix/environ filesystem/posix/filesystem heap/posix/heap \
    ifaddrs/posix/ifaddrs process/posix/process random/posix/random rusage/posix/rusage \
    sockets/posix/gethostname sockets/posix/socket sync/posix/sync threads/posix/threads \
    time/posix/time";
/// Files of features that are left out (`include/dds/features.h`).
const LEFT_OUT: [&str; 16] = [
    "dds_dynamic_type.c",
    "dds_qos_provider.c",
    "dds_sysdef_parser.c",
    "dds_sysdef_validation.c",
    "ddsi_discovery_topic.c",
    "ddsi_dynamic_type.c",
    "ddsi_lifespan.c",
    "ddsi_security_exchange.c",
    "ddsi_security_msg.c",
    "ddsi_typebuilder.c",
    "ddsi_typelib.c",
    "ddsi_typelookup.c",
    "ddsi_typewrap.c",
    "ddsi_xt_typeinfo.c",
    "ddsi_xt_typelookup.c",
    "ddsi_xt_typemap.c",
];

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=include");
    println!("cargo::rerun-if-env-changed=CC");
    println!("cargo::rerun-if-env-changed=AR");
    match build() {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("Cyclone DDS was not built: {why}");
            ExitCode::FAILURE
        }
    }
}

fn build() -> Result<(), String> {
    let folder = PathBuf::from(variable("OUT_DIR")?);
    let sources = cyclonedds_src::source_dir().join("src");
    let own = PathBuf::from(variable("CARGO_MANIFEST_DIR")?).join("include");
    let mut included = vec![own];
    included.extend(INCLUDED.map(|part| sources.join(part)));
    let files = files(&sources)?;
    let objects: Vec<PathBuf> =
        (0..files.len()).map(|number| folder.join(format!("{number}.o"))).collect();
    let compile = |file: &Path, object: &Path| {
        let mut command = Command::new(program("CC", "cc"));
        command.args(FLAGS).args(included.iter().map(|part| format!("-I{}", part.display())));
        run(command.arg("-c").arg(file).arg("-o").arg(object))
    };
    on_all_processors(files.len(), &|number| compile(&files[number], &objects[number]))?;
    let archive = folder.join("libddsc.a");
    if archive.exists() {
        std::fs::remove_file(&archive).map_err(|error| error.to_string())?;
    }
    run(Command::new(program("AR", "ar")).arg("rcs").arg(&archive).args(&objects))?;
    println!("cargo::metadata=archive={}", archive.display());
    // The first ones are public.
    let public: Vec<String> =
        included.iter().take(5).map(|part| part.display().to_string()).collect();
    println!("cargo::metadata=include={}", public.join(":"));
    Ok(())
}

/// All files that are compiled.
fn files(sources: &Path) -> Result<Vec<PathBuf>, String> {
    let runtime = RUNTIME.split_whitespace();
    let mut all: Vec<PathBuf> =
        runtime.map(|name| sources.join(format!("ddsrt/src/{name}.c"))).collect();
    all.push(sources.join("core/ddsi/defconfig.c"));
    for folder in ["core/cdr/src", "core/ddsi/src", "core/ddsc/src"] {
        let folder = sources.join(folder);
        let listed = std::fs::read_dir(&folder)
            .map_err(|error| format!("{} can't be listed: {error}", folder.display()))?;
        for file in listed {
            let file = file.map_err(|error| error.to_string())?.path();
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name.ends_with(".c") && !LEFT_OUT.contains(&&*name) {
                all.push(file);
            }
        }
    }
    all.sort();
    Ok(all)
}

/// Does `work` for each number below `count`; the first failure ends it.
fn on_all_processors(
    count: usize,
    work: &(dyn Fn(usize) -> Result<(), String> + Sync),
) -> Result<(), String> {
    let threads: usize = variable("NUM_JOBS")?.parse().unwrap_or(1);
    let next = AtomicUsize::new(0);
    let some = || -> Result<(), String> {
        loop {
            let number = next.fetch_add(1, Relaxed);
            if number >= count {
                return Ok(());
            }
            work(number).inspect_err(|_| next.store(count, Relaxed))?;
        }
    };
    std::thread::scope(|scope| {
        let all: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(some)).collect();
        all.into_iter().try_for_each(|one| one.join().unwrap_or(Err("a thread panicked".into())))
    })
}

/// What a variable names: for another architecture neither is the machine's own.
fn program(variable: &str, usual: &str) -> std::ffi::OsString {
    std::env::var_os(variable).unwrap_or_else(|| usual.into())
}

fn run(command: &mut Command) -> Result<(), String> {
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        other => Err(format!("{command:?}: {other:?}")),
    }
}

fn variable(name: &str) -> Result<String, String> {
    std::env::var(name).map_err(|_| format!("{name} is not set: cargo starts this program"))
}
