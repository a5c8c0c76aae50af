#include "server/http/json_mapping.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/http/errors.h"

namespace depthtween::server {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

const FieldDescriptor* FieldByName(const Descriptor* type, const std::string& name) {
  if (const FieldDescriptor* field = type->FindFieldByName(name)) return field;
  const FieldDescriptor* field = type->FindFieldByCamelcaseName(name);
  return field != nullptr && field->json_name() == name ? field : nullptr;
}

google::protobuf::util::Status ParseJson(const std::string& json, Message* message) {
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = false;
  return google::protobuf::util::JsonStringToMessage(json, message, options);
}

// The field that protobuf's error is about, if it says so: "(job.options) key_evry: Cannot find field.",
// "job: Cannot find field.", "(job.threads): invalid value ...".
std::string FieldInError(std::string_view message) {
  std::string path;
  if (!message.empty() && message.front() == '(') {
    const size_t close = message.find(')');
    if (close == std::string_view::npos) return "";
    path = std::string(message.substr(1, close - 1));
    message.remove_prefix(close + 1);
    if (!message.empty() && message.front() == ' ') message.remove_prefix(1);
  }
  const size_t colon = message.find(": Cannot find field");
  if (colon == std::string_view::npos) return path;
  const std::string name(message.substr(0, colon));
  return path.empty() ? name : absl::StrCat(path, ".", name);
}

google::rpc::Status JsonError(const std::string& outer_field, const google::protobuf::util::Status& status) {
  const std::string text(status.message().data(), status.message().size());
  const std::string inner = FieldInError(text);
  if (absl::StrContains(text, "Cannot find field")) {
    return FieldError(outer_field.empty() ? inner : absl::StrCat(outer_field, ".", inner),
                      "is no field of this request");
  }
  // What it says is worth reading, and quotes the text at length.
  const std::string field =
      outer_field.empty() || inner.empty() ? absl::StrCat(outer_field, inner) : absl::StrCat(outer_field, ".", inner);
  return FieldError(field, absl::StrCat(field.empty() ? "the request's body" : "",
                                        " must be JSON that fits the request: ", text.substr(0, 300)));
}

std::string QuoteJson(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      result.push_back('\\');
      result.push_back(c);
    } else if (static_cast<unsigned char>(c) < ' ') {
      absl::StrAppend(&result, "\\u00", absl::Hex(static_cast<unsigned char>(c), absl::kZeroPad2));
    } else {
      result.push_back(c);
    }
  }
  result.push_back('"');
  return result;
}

// What a parameter of this type must look like.
std::string_view RuleOf(const FieldDescriptor& field) {
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_BOOL:
      return "true or false";
    case FieldDescriptor::CPPTYPE_ENUM:
      return "a name of its enum";
    case FieldDescriptor::CPPTYPE_DOUBLE:
    case FieldDescriptor::CPPTYPE_FLOAT:
      return "a number";
    case FieldDescriptor::CPPTYPE_STRING:
      return "base64";
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return "a value such as a time (2030-01-31T12:00:00Z) or a duration (1.5s)";
    default:
      return "an integer in the range of its type";
  }
}

google::rpc::Status BadValue(const std::string& name, const std::string& value, const FieldDescriptor& field) {
  return FieldError(name, absl::StrCat("= \"", value.substr(0, 100), "\", must be ", std::string(RuleOf(field))));
}

// One value into a field of `message` itself.
google::rpc::Status SetField(const std::string& name, const std::string& value, const FieldDescriptor& field,
                             Message* message) {
  const Reflection* reflection = message->GetReflection();
  if (field.is_map()) return FieldError(name, "cannot be a query parameter; it belongs to the body");
  if (!field.is_repeated() && field.has_presence() && reflection->HasField(*message, &field)) {
    return FieldError(name, "is given more than once");
  }
  if (field.type() == FieldDescriptor::TYPE_STRING) {
    if (field.is_repeated()) {
      reflection->AddString(message, &field, value);
    } else {
      reflection->SetString(message, &field, value);
    }
    return {};
  }
  // All other types by way of protobuf's JSON, whose strings hold any of them; so there is one reading of each type.
  const bool is_bool = field.cpp_type() == FieldDescriptor::CPPTYPE_BOOL;
  if (is_bool && value != "true" && value != "false") return BadValue(name, value, field);
  const std::string json_value = is_bool ? value : QuoteJson(value);
  const std::string json = absl::StrCat("{", QuoteJson(field.json_name()), ":", field.is_repeated() ? "[" : "",
                                        json_value, field.is_repeated() ? "]" : "", "}");
  const std::unique_ptr<Message> one(message->New());
  if (value.empty() || !ParseJson(json, one.get()).ok()) return BadValue(name, value, field);
  message->MergeFrom(*one);
  return {};
}

google::rpc::Status SetQueryParameter(const std::string& name, const std::string& value, Message* request) {
  Message* message = request;
  const std::vector<std::string> path = absl::StrSplit(name, '.');
  for (size_t i = 0; i < path.size(); ++i) {
    const FieldDescriptor* field = FieldByName(message->GetDescriptor(), path[i]);
    if (field == nullptr) return FieldError(name, "is no parameter of this method");
    if (i + 1 == path.size()) return SetField(name, value, *field, message);
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE || field->is_repeated()) {
      return FieldError(name, "is no parameter of this method");
    }
    message = message->GetReflection()->MutableMessage(message, field);
  }
  return {};
}

// A value of the path, which wins; but a body that says something else is a mistake to be told of.
google::rpc::Status SetPathValue(const std::string& name, const std::string& value, Message* request) {
  Message* message = request;
  const std::vector<std::string> path = absl::StrSplit(name, '.');
  for (size_t i = 0; i + 1 < path.size(); ++i) {
    const FieldDescriptor* field = FieldByName(message->GetDescriptor(), path[i]);
    message = message->GetReflection()->MutableMessage(message, field);
  }
  const FieldDescriptor* field = FieldByName(message->GetDescriptor(), path.back());
  const std::string before = message->GetReflection()->GetString(*message, field);
  if (!before.empty() && before != value) {
    return FieldError(name,
                      absl::StrCat("= \"", before.substr(0, 100), "\", must be \"", value, "\" as the path says"));
  }
  message->GetReflection()->SetString(message, field, value);
  return {};
}

google::rpc::Status ParseBody(const HttpParts& parts, Message* request) {
  if (parts.body.empty()) return {};
  if (parts.body_field.empty()) {
    return FieldError("", "the request has a body, and this method takes none; use query parameters");
  }
  if (JsonDepth(parts.body, kMaxJsonDepth) > kMaxJsonDepth) {
    return FieldError("", absl::StrCat("the request's body is nested deeper than ", kMaxJsonDepth, " levels"));
  }
  if (parts.body_field == "*") {
    const auto parsed = ParseJson(parts.body, request);
    return parsed.ok() ? google::rpc::Status() : JsonError("", parsed);
  }
  const FieldDescriptor* field = FieldByName(request->GetDescriptor(), parts.body_field);
  const auto parsed = ParseJson(parts.body, request->GetReflection()->MutableMessage(request, field));
  return parsed.ok() ? google::rpc::Status() : JsonError(field->json_name(), parsed);
}

}  // namespace

int JsonDepth(std::string_view json, int limit) {
  int depth = 0, deepest = 0;
  bool in_string = false;
  for (size_t i = 0; i < json.size() && deepest <= limit; ++i) {
    const char c = json[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      deepest = std::max(deepest, ++depth);
    } else if (c == '}' || c == ']') {
      --depth;
    }
  }
  return deepest;
}

google::rpc::Status FillRequest(const HttpParts& parts, Message* request) {
  google::rpc::Status error = ParseBody(parts, request);
  for (const auto& [name, value] : parts.query) {
    if (error.code() != 0) return error;
    if (name == "signature") continue;
    if (parts.body_field == "*") {
      error = FieldError(name, "is a query parameter; here every field belongs to the body");
    } else if (!parts.body_field.empty() && absl::StartsWith(absl::StrCat(name, "."), parts.body_field + ".")) {
      error = FieldError(name, "belongs to the body");
    } else {
      error = SetQueryParameter(name, value, request);
    }
  }
  for (const auto& [name, value] : parts.path_values) {
    if (error.code() != 0) return error;
    error = SetPathValue(name, value, request);
  }
  return error;
}

absl::StatusOr<std::string> PrintJson(const Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  std::string json;
  const auto printed = google::protobuf::util::MessageToJsonString(message, &json, options);
  if (!printed.ok()) {
    return absl::InternalError(
        absl::StrCat("an answer does not fit JSON: ", std::string(printed.message().data(), printed.message().size())));
  }
  return json;
}

}  // namespace depthtween::server
