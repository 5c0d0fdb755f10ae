// SPDX-License-Identifier: Apache-2.0
#include "server/admin/rig_client.h"

#include <chrono>
#include <random>
#include <utility>

#include "common/wire/network_path.h"
#include "common/wire/partition.h"
#include "server/admin/own_name.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kPeriod{20};  // of saying an order again; a rig waits for 40 ms at least
constexpr std::chrono::seconds kPatience{5};

}  // namespace

Result<RigClient> RigClient::join(const RigClientOptions& options) {
  auto joining = joining_options(options, options.host);
  if (!joining) return tl::unexpected(joining.error());
  joining->role = wire::Role::kRigClient;
  auto name = operator_name(options.security);
  if (!name) return tl::unexpected(name.error());
  auto participant = wire::Participant::create(*joining);
  if (!participant) return tl::unexpected(participant.error());
  auto orders = wire::Writer<wire::RigCommand>::create(*participant,
                                                       wire::operator_to_rig_partition(options.rig, *name));
  if (!orders) return tl::unexpected(orders.error());
  auto states = wire::Reader<wire::RigState>::create(*participant, wire::kEveryRig);
  if (!states) return tl::unexpected(states.error());
  auto waiter = wire::Waiter::create(*participant);
  if (!waiter) return tl::unexpected(waiter.error());
  if (Status attached = waiter->attach({*states}); !attached) return tl::unexpected(attached.error());
  return RigClient(options, *std::move(name), *std::move(participant), *std::move(orders), *std::move(states),
                   *std::move(waiter));
}

RigClient::RigClient(RigClientOptions options, std::string name, wire::Participant participant,
                     wire::Writer<wire::RigCommand> orders, wire::Reader<wire::RigState> states,
                     wire::Waiter waiter)
    : options_(std::move(options)),
      name_(std::move(name)),
      participant_(std::move(participant)),
      orders_(std::move(orders)),
      states_(std::move(states)),
      waiter_(std::move(waiter)) {
  std::random_device device;
  order_.order.session = {uint64_t{device()} << 32 | device() | 1};
}

std::optional<wire::RigState> RigClient::next_state() {
  (void)waiter_.wait(kPeriod);
  std::optional<wire::RigState> newest;
  for (auto& sample : states_.take()) {
    // A rig that says to be another is believed neither of them.
    if (!sample.message ||
        states_.partition_of(sample.publication) != wire::rig_partition(sample.message->rig))
      continue;
    if (sample.message->rig == options_.rig) {
      newest = std::move(sample.message);
    } else {
      other_rig_ = sample.message->rig;
    }
  }
  return newest;
}

Error RigClient::no_rig() const {
  const std::string heard = other_rig_.empty() ? "" : "; the rig there is called " + other_rig_;
  return {ErrorCode::kNoServer, "no rig " + options_.rig + " answers at " + options_.host + ", domain " +
                                    std::to_string(options_.domain) + ", asked " +
                                    wire::way_to(options_.host, participant_.path()) + heard +
                                    "; is cairn-rig running there? --at names another host"};
}

Result<wire::RigState> RigClient::state() {
  const auto deadline = steady_clock::now() + kPatience;
  while (steady_clock::now() < deadline) {
    if (auto state = next_state()) return *std::move(state);
  }
  return tl::unexpected(no_rig());
}

Result<wire::RigState> RigClient::give(wire::RigCommand order) {
  order.rig = options_.rig;
  order.commander = name_;
  order.order = {order_.order.session, order_.order.seq + 1};
  order_ = std::move(order);
  const auto deadline = steady_clock::now() + kPatience;
  while (steady_clock::now() < deadline) {
    if (Status written = orders_.write(order_); !written) return tl::unexpected(written.error());
    const auto state = next_state();
    if (!state || state->order != order_.order) continue;
    if (!state->refusal.empty()) return fail(ErrorCode::kRefused, state->refusal);
    return *state;
  }
  return tl::unexpected(no_rig());
}

Result<wire::RigState> RigClient::hold(const std::function<bool(const wire::RigState&)>& is_over,
                                       const Asked& asked) {
  std::optional<wire::RigState> last;
  auto heard = steady_clock::now();
  while (steady_clock::now() - heard < kPatience) {
    if (Status written = orders_.write(order_); !written) return tl::unexpected(written.error());
    const auto said = steady_clock::now();
    while (steady_clock::now() - said < kPeriod) {
      if (auto state = next_state()) {
        last = std::move(state);
        heard = steady_clock::now();
        if (is_over(*last)) return *last;
      }
      if (last && asked()) return *last;
    }
  }
  return tl::unexpected(no_rig());
}

}  // namespace cairn
