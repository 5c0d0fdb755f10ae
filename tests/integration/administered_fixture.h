// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <optional>

#include "server/admin/admin_client.h"
#include "tests/integration/label_fixture.h"

namespace cairn::testing {

/// A service with anna, and an operator of it.
class AdministeredFixture : public LabelFixture {
 protected:
  using json = nlohmann::json;

  AdministeredFixture() { connect(); }
  void connect() {
    AdminClientOptions connection;
    connection.domain = service_options_.domain;
    admin_.emplace(AdminClient::connect(connection).value());
  }
  json done(const json& request) {
    const auto answer = admin_->ask(request);
    EXPECT_TRUE(answer) << answer.error().message;
    return answer ? answer->content : json::object();
  }

  std::optional<AdminClient> admin_;
};

}  // namespace cairn::testing
