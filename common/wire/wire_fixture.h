// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "common/wire/log_redirect.h"
#include "common/wire/participant.h"
#include "common/wire/test_messages.h"
#include "common/wire/topic.h"

/// Tests of the middleware itself, over the loopback interface. Each test has a domain of its own.
namespace cairn::wire {

constexpr unsigned kSeed = 11;
constexpr uint32_t kDomains = 95;  ///< domains 5 to 99: their ports lie below those that the kernel hands out

inline bool eventually(const std::function<bool()>& predicate,
                       std::chrono::milliseconds limit = std::chrono::seconds(20)) {
  const auto deadline = std::chrono::steady_clock::now() + limit;
  while (!predicate()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

class WireTest : public ::testing::Test {
 protected:
  /// A server in a domain that nobody else uses at this moment.
  Participant server(int loss_per_mille = 0, const std::string& profile = "loopback",
                     Logger log = null_logger()) {
    ParticipantOptions options;
    options.log = std::move(log);
    options.role = Role::kServer;
    options.profile = profile;
    options.loss_per_mille = loss_per_mille;
    for (uint32_t i = 0; i < kDomains; ++i) {
      options.domain = 5 + (static_cast<uint32_t>(getpid()) * 7 + i) % kDomains;
      auto made = Participant::create(options);
      if (made) {
        domain_ = options.domain;
        return *std::move(made);
      }
      if (made.error().code != ErrorCode::kRefused) throw std::runtime_error(made.error().message);
    }
    throw std::runtime_error("no free domain");
  }
  Participant server_again() {
    ParticipantOptions options;
    options.role = Role::kServer;
    options.domain = domain_;
    return Participant::create(options).value();
  }
  /// A client of that server.
  Participant client(int loss_per_mille = 0) const {
    ParticipantOptions options;
    options.domain = domain_;
    options.loss_per_mille = loss_per_mille;
    return Participant::create(options).value();
  }

  const LogRedirect quiet_{null_logger()};  // the search for a free domain is noisy
  testing::RandomMessages random_{kSeed};
  uint32_t domain_ = 0;
};

template <typename Message>
Writer<Message> writer(const Participant& participant, std::string_view partition) {
  return Writer<Message>::create(participant, partition).value();
}
template <typename Message>
Reader<Message> reader(const Participant& participant, std::string_view partition) {
  return Reader<Message>::create(participant, partition).value();
}

/// Takes until `count` samples have come.
template <typename Message>
std::vector<Sample<Message>> collect(Reader<Message>* from, size_t count) {
  std::vector<Sample<Message>> all;
  eventually([&] {
    for (auto& sample : from->take()) all.push_back(std::move(sample));
    return all.size() >= count;
  });
  return all;
}

}  // namespace cairn::wire
