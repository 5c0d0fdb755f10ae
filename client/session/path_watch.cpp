// SPDX-License-Identifier: Apache-2.0
#include "client/session/path_watch.h"

#include <utility>

namespace cairn {
namespace {

std::string change_of(const std::string& host, const wire::NetworkPath& before,
                      const wire::NetworkPath& now) {
  std::string text;
  if (now.server != before.server)
    text = "the server '" + host + "' has the address " + now.server + " instead of " + before.server;
  if (now.interface == before.interface && now.address == before.address) return text;
  return text + (text.empty() ? "" : ", and ") + "this machine reaches it by " + describe(now) +
         " instead of " + describe(before);
}

}  // namespace

PathWatch::Advice PathWatch::compare(const Result<wire::NetworkPath>& now) {
  Advice advice;
  if (!now) {
    advice.text = "the server is not heard: " + now.error().message;
  } else if (!joined_) {
    advice.join_anew = true;
  } else if (*now != *joined_) {
    advice = {true, change_of(host_, *joined_, *now) + ": joining anew"};
  }
  if (!advice.text.empty() && std::exchange(said_, advice.text) == advice.text) advice.text.clear();
  return advice;
}

}  // namespace cairn
