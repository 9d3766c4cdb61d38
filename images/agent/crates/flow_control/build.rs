//! Names the folder of the C sources to the build scripts of crates that depend on this one.

fn main() {
    println!("cargo::rerun-if-changed=flow");
    println!("cargo::metadata=folder={}/flow", env!("CARGO_MANIFEST_DIR"));
}
