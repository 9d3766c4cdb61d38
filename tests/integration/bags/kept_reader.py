"""What rosbag's Python reads of bags, in the lines of kept_reader.cpp; run by /usr/bin/python3."""

import sys
import zlib

import rosbag  # type: ignore[import-not-found]


def text(value: bytes | str) -> str:
    return value.decode() if isinstance(value, bytes) else value


def main() -> None:
    for name in sys.argv[1:]:
        print(name)
        try:
            with rosbag.Bag(name) as bag:
                for topic, raw, time, header in bag.read_messages(
                    raw=True, return_connection_header=True
                ):
                    fields = {text(key): text(value) for key, value in header.items()}
                    fields_out = [topic, time.to_nsec(), len(raw[1]), zlib.crc32(raw[1])]
                    fields_out += [fields.get("callerid", ""), int(fields.get("latching", "0"))]
                    fields_out += [raw[0], fields["md5sum"]]
                    fields_out.append(zlib.crc32(fields["message_definition"].encode()))
                    print(*fields_out, sep="\t")
        except Exception as error:  # noqa: BLE001  what it says is compared
            print(type(error).__name__, error)


if __name__ == "__main__":
    main()
