// As pass_on.py: each record goes back as it came, piece by piece, whatever its size.
#include "binpipe.hpp"

int main() {
  binpipe::Pipe pipe;
  while (auto* record = pipe.next()) {
    pipe.begin(record->name, record->size);
    for (auto piece = record->piece(); !piece.empty(); piece = record->piece()) pipe.append(piece);
  }
  return pipe.close();
}
