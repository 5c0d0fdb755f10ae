// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "common/base/result.h"
#include "common/wire/participant.h"
#include "common/wire/rig_messages.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn {

struct RigClientOptions {
  std::string rig;
  std::string host = "localhost";  ///< of cairn-rig
  int domain = 0;
  std::string profile;        ///< empty: loopback for localhost, wifi otherwise
  std::string listen;         ///< interface or address of this machine; empty: that of the way to the rig
  std::string security = {};  ///< folder of the operator's keys; empty: an open site
};

/// An operator's line to a rig's own program, without a server between: an emergency stop needs no more than
/// that. Orders are said again as a commander does. One thread.
class RigClient {
 public:
  using Asked = std::function<bool()>;

  /// Joins the network; the rig need not be there. Errors: kUsage (domain, host), kConfiguration.
  [[nodiscard]] static Result<RigClient> join(const RigClientOptions& options);

  /// The state of the rig, as it says now. Error kNoServer.
  [[nodiscard]] Result<wire::RigState> state();
  /// Gives an order, until the rig says that it carries it out. Of `order`, the mode and what belongs to it
  /// count. Errors: kNoServer, and kRefused with the rig's reason.
  [[nodiscard]] Result<wire::RigState> give(wire::RigCommand order);
  /// Goes on saying the order that was given, until `is_over` of a state or `asked` is true. Returns the last
  /// state. Error kNoServer: the rig has fallen silent.
  [[nodiscard]] Result<wire::RigState> hold(const std::function<bool(const wire::RigState&)>& is_over,
                                            const Asked& asked);

 private:
  RigClient(RigClientOptions options, std::string name, wire::Participant participant,
            wire::Writer<wire::RigCommand> orders, wire::Reader<wire::RigState> states, wire::Waiter waiter);
  /// The newest that comes within one period; of another rig, its name is kept.
  [[nodiscard]] std::optional<wire::RigState> next_state();
  [[nodiscard]] Error no_rig() const;

  RigClientOptions options_;
  std::string name_;  ///< of the operator
  wire::Participant participant_;
  wire::Writer<wire::RigCommand> orders_;
  wire::Reader<wire::RigState> states_;
  wire::Waiter waiter_;
  std::string other_rig_;  ///< that was heard
  wire::RigCommand order_;
};

}  // namespace cairn
