// A detector of the paper's latency: sleeps a given number of milliseconds for each byte of a
// record, which stands for an image, and answers "done". It starts in no time, as the sleeping is
// the whole of the workload.
#include <chrono>
#include <cstdlib>
#include <thread>

#include "binpipe.hpp"

int main(int, char** arguments) {
  const std::chrono::milliseconds image(std::atoi(arguments[1]));
  binpipe::Pipe pipe;
  while (auto* record = pipe.next()) {
    for (auto piece = record->piece(); !piece.empty(); piece = record->piece())
      std::this_thread::sleep_for(image * piece.size());
    pipe.begin("done", 4);
    pipe.append("done");
  }
  return pipe.close();
}
