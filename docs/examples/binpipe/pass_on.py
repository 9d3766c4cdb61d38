"""The least user logic: each record goes back as it came, piece by piece, whatever its size."""

from bagpipe import binpipe

for record in binpipe.read():
    with binpipe.create(record.name, record.size) as output:
        for piece in record.pieces():
            output.write(piece)
