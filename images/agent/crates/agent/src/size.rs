//! Sizes in bytes, as people write them.

pub fn bytes(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|letter: char| letter.is_ascii_alphabetic());
    let factor = match &text[digits.len()..] {
        "" | "B" => 1,
        "KiB" | "Ki" => 1 << 10,
        "MiB" | "Mi" => 1 << 20,
        "GiB" | "Gi" => 1 << 30,
        unit => return Err(format!("unit {unit:?}: write KiB, MiB or GiB, or plain bytes")),
    };
    let number: u64 = digits.trim().parse().map_err(|error| format!("{digits:?}: {error}"))?;
    number.checked_mul(factor).ok_or_else(|| format!("{text} is more than 64 bits can say"))
}

#[cfg(test)]
mod tests {
    #[test]
    fn sizes_have_units() {
        assert_eq!(super::bytes("4GiB"), Ok(4 << 30));
        assert_eq!(super::bytes("17"), Ok(17));
        assert!(super::bytes("4 gigs").is_err_and(|text| text.contains("write KiB")));
        assert!(super::bytes("GiB").is_err());
        assert!(super::bytes("99999999999GiB").is_err());
    }
}
