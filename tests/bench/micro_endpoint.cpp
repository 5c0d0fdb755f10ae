// SPDX-License-Identifier: Apache-2.0
//
// cairn-micro: what the server's I/O thread does for each sample that comes in, until it knows whose it is.
// It must not depend on how many clients there are.
#include <benchmark/benchmark.h>

#include <unistd.h>

#include <algorithm>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/wire/partition.h"
#include "server/endpoint/publications.h"
#include "tests/bench/timing.h"

namespace cairn {
namespace {

template <typename T>
T made(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}

/// The server's inlet of states, and so many clients that write to it, all of which have been heard.
class States {
 public:
  explicit States(size_t clients)
      : participant_(made(wire::Participant::create(joining(wire::Role::kServer)))),
        clients_(made(wire::Participant::create(joining(wire::Role::kClient)))),
        inlet_{made(wire::Reader<wire::TrackerStateMessage>::create(participant_, wire::kEveryClient))} {
    for (size_t i = 0; i < clients; ++i) {
      const std::string name = "client-" + std::to_string(i);
      ids_.push_back(client_id_from_name(name));
      writers_.push_back(
          made(wire::Writer<wire::TrackerStateMessage>::create(clients_, wire::client_partition(name))));
    }
    for (int round = 0; heard_.size() < clients; ++round) {
      if (round == kMostRounds) throw std::runtime_error("not all clients are heard");
      write();
      static_cast<void>(take());
    }
  }
  void write() {
    for (size_t i = 0; i < writers_.size(); ++i) {
      wire::TrackerStateMessage state;
      state.client = ids_[i];
      state.session = {1};
      static_cast<void>(writers_[i].write(state));
    }
  }
  /// How many there were, all of whom are known.
  [[nodiscard]] size_t take() {
    size_t taken = 0;
    wire::take_all(inlet_.reader, [&](auto& sample) {
      const Publications::Publication* source = inlet_.source(sample);
      if (source == nullptr || !sample.message || source->client_id != sample.message->client) return;
      heard_.insert(source->client_id);
      ++taken;
    });
    return taken;
  }

 private:
  static constexpr int kMostRounds = 1000;
  /// Clients speak with the server of their domain only.
  static wire::ParticipantOptions joining(wire::Role role) {
    wire::ParticipantOptions options;
    options.role = role;
    options.domain = static_cast<uint32_t>(5 + getpid() % 95);  // ports below those that the kernel hands out
    return options;
  }
  wire::Participant participant_;
  wire::Participant clients_;
  Inlet<wire::TrackerStateMessage> inlet_;
  std::vector<ClientId> ids_;
  std::vector<wire::Writer<wire::TrackerStateMessage>> writers_;
  std::set<ClientId> heard_;
};

/// `ratio`: to a sample of the first run, of ten clients.
void BM_IngressOfAState(benchmark::State& state) {
  static std::optional<double> with_few;
  States states(static_cast<size_t>(state.range(0)));
  double ms = 0;
  size_t taken = 0;
  for (auto _ : state) {
    states.write();
    const double began = thread_cpu_ms();
    const size_t now = states.take();
    const double took = thread_cpu_ms() - began;
    ms += took;
    taken += now;
    state.SetIterationTime(took * 1e-3);
  }
  const double ns = ms * 1e6 / static_cast<double>(std::max<size_t>(taken, 1));
  if (!with_few) with_few = ns;
  state.counters["ns_each"] = ns;
  state.counters["ratio"] = ns / *with_few;
}
BENCHMARK(BM_IngressOfAState)->Arg(10)->Arg(1000)->UseManualTime()->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace cairn
