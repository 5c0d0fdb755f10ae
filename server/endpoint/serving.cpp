// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/serving.h"

#include <cerrno>
#include <ctime>
#include <utility>

#include "common/base/exit_deadline.h"
#include "common/wire/network_path.h"

namespace cairn {
namespace {

constexpr time_t kLookSeconds = 1;

/// Whether one of the signals came within the time between two looks.
bool is_signalled(const sigset_t& signals) {
  const timespec interval{kLookSeconds, 0};
  return sigtimedwait(&signals, nullptr, &interval) > 0;
}

/// Starts the same server once more at the present address: clients know it by its store. Its port may be
/// held for a moment, or the address go again: it goes on until the server runs or a signal comes (`service`
/// is null then). Error: the store cannot be used.
Status begin_anew(const sigset_t& signals, const ServiceOptions& options, std::unique_ptr<Service>* service,
                  const Logger& log) {
  (*service)->close();
  {
    // All is kept: where the middleware holds it up, the process begins again as it was begun.
    const ExitDeadline deadline(own_command(), kClosingPatience, log);
    service->reset();
  }
  for (bool told = false; !*service;) {
    auto begun = Service::start(options, log);
    if (begun) {
      *service = std::move(*begun);
    } else if (begun.error().code == ErrorCode::kIo || begun.error().code == ErrorCode::kDamaged) {
      return tl::unexpected(begun.error());
    } else {
      if (!std::exchange(told, true)) log->warn("cannot serve anew yet: {}", begun.error().message);
      if (is_signalled(signals)) return {};
    }
  }
  log->warn("serving again, on {}", describe((*service)->network()));
  return {};
}

}  // namespace

OwnAddress::Event OwnAddress::look(bool is_here, const Result<wire::NetworkPath>& now) {
  if (is_here || in_use_.address.empty()) {
    told_.reset();
    return Event::kNone;
  }
  const wire::NetworkPath place = now.value_or(wire::NetworkPath{});
  if (std::exchange(told_, place) == place) return Event::kNone;
  return place.address.empty() ? Event::kGone : Event::kMoved;
}

Status serve_until(const sigset_t& signals, const ServiceOptions& options, std::unique_ptr<Service>* service,
                   const Logger& log) {
  OwnAddress address((*service)->network());
  // Where another interface was all that is left, it would be stayed on for ever.
  ServiceOptions here = options;
  if (here.listen.empty()) here.listen = address.in_use().interface;
  while (!is_signalled(signals)) {
    const bool is_here = wire::has_address(address.in_use().address);
    const auto now = wire::find_path(joining_options(here));
    const OwnAddress::Event event = address.look(is_here, now);
    if (event == OwnAddress::Event::kNone) continue;
    const std::string before = describe(address.in_use());
    if (event == OwnAddress::Event::kGone) {
      log->warn(
          "this machine has {} no more: trackers elsewhere are not heard until that interface has an "
          "address, or the server is started again on another (--listen)",
          before);
    } else if (options.store.empty()) {
      log->warn(
          "this machine has {} instead of {}: trackers elsewhere are not heard any more. Start the server "
          "again to serve there; its maps end with it (with --store it goes over by itself and keeps them)",
          describe(*now), before);
    } else {
      log->warn("this machine has {} instead of {}: serving anew from the store", describe(*now), before);
      if (Status begun = begin_anew(signals, here, service, log); !begun || !*service) return begun;
      address = OwnAddress((*service)->network());
    }
  }
  return {};
}

}  // namespace cairn
