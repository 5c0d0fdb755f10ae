// SPDX-License-Identifier: Apache-2.0
#include "tests/integration/test_domain.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <stdexcept>
#include <thread>

namespace cairn::testing {
namespace {

constexpr int kFirstDomain = 5;
constexpr int kDomains = 95;  // up to 99: ports below 32768

}  // namespace

bool eventually(const std::function<bool()>& predicate, std::chrono::milliseconds limit) {
  const auto deadline = std::chrono::steady_clock::now() + limit;
  while (!predicate()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

int next_domain() {
  static std::atomic<int> calls{0};  // tests of one program
  return kFirstDomain + (getpid() * 11 + calls++) % kDomains;
}

std::unique_ptr<Service> start_service(ServiceOptions* options) {
  name_this_start(options);
  for (int i = 0; i < kDomains; ++i) {
    options->domain = next_domain();
    auto service = Service::start(*options, null_logger());
    if (service) return std::move(*service);
    if (service.error().code != ErrorCode::kRefused) throw std::runtime_error(service.error().message);
  }
  throw std::runtime_error("no free domain");
}

std::unique_ptr<Service> start_same_service(const ServiceOptions& options) {
  auto service = Service::start(options, null_logger());
  if (!service) throw std::runtime_error(service.error().message);
  return std::move(*service);
}

std::unique_ptr<Session> open_session(const SessionOptions& options, const CameraPtr& camera) {
  auto session = Session::open(options, camera, null_logger());
  if (!session) throw std::runtime_error(session.error().message);
  return std::move(*session);
}

std::unique_ptr<Session> open_known_session(const SessionOptions& options, const CameraPtr& camera) {
  auto session = open_session(options, camera);
  EXPECT_TRUE(session->wait_for_server(std::chrono::seconds(60)));
  EXPECT_TRUE(session->wait_for_name(std::chrono::seconds(60)));
  return session;
}

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 400, 300, {330, 330, 199.5, 149.5, 0, 0, 0, 0, 0}});
}

}  // namespace cairn::testing
