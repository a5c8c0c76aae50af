#include "server/rpc/render_options.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <cmath>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "nlohmann/json.hpp"
#include "server/rpc/status.h"

namespace depthtween::server {
namespace {

using google::protobuf::EnumDescriptor;
using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;
using nlohmann::json;

constexpr int kMaxElements = 1000;

// "FRAME_FORMAT_" of FrameFormat.
std::string PrefixOf(const EnumDescriptor& type) {
  std::string prefix;
  for (const char c : type.name()) {
    if (absl::ascii_isupper(c) && !prefix.empty()) prefix += '_';
    prefix += absl::ascii_toupper(c);
  }
  return prefix + "_";
}

std::string WordOf(const EnumValueDescriptor& value) {
  const std::string word = value.name().substr(PrefixOf(*value.type()).size());
  return absl::AsciiStrToLower(absl::StrReplaceAll(word, {{"_", "-"}}));
}

absl::StatusOr<json> ToJson(const std::string& path, const Message& message);

absl::StatusOr<json> ValueToJson(const std::string& path, const Message& message, const FieldDescriptor& field) {
  const Reflection& reflection = *message.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE: {
      const double value = reflection.GetDouble(message, &field);
      if (!std::isfinite(value)) return InvalidField(path, absl::StrCat("= ", value, ", must be a finite number"));
      return value;
    }
    case FieldDescriptor::CPPTYPE_INT32:
      return reflection.GetInt32(message, &field);
    case FieldDescriptor::CPPTYPE_BOOL:
      return reflection.GetBool(message, &field);
    case FieldDescriptor::CPPTYPE_STRING:
      return reflection.GetString(message, &field);
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return ToJson(path, reflection.GetMessage(message, &field));
    case FieldDescriptor::CPPTYPE_ENUM: {
      const int number = reflection.GetEnumValue(message, &field);
      const EnumValueDescriptor* value = field.enum_type()->FindValueByNumber(number);
      if (value == nullptr) {
        return InvalidField(path, absl::StrCat("= ", number, ", must be a value that this server knows"));
      }
      return WordOf(*value);
    }
    default:
      return absl::InternalError(absl::StrCat(path, " is of a type that options do not have"));
  }
}

absl::StatusOr<json> ToJson(const std::string& path, const Message& message) {
  const Reflection& reflection = *message.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);  // those that are set, or not their default
  json object = json::object();
  for (const FieldDescriptor* field : fields) {
    const std::string field_path = absl::StrCat(path, ".", field->name());
    if (!field->is_repeated()) {
      ASSIGN_OR_RETURN(object[field->name()], ValueToJson(field_path, message, *field));
      continue;
    }
    const int count = reflection.FieldSize(message, field);
    if (count > kMaxElements) {
      return InvalidField(field_path, absl::StrCat("has ", count, " elements, must have at most ", kMaxElements));
    }
    json& list = object[field->name()] = json::array();
    for (int i = 0; i < count; ++i) {
      ASSIGN_OR_RETURN(list.emplace_back(),
                       ToJson(absl::StrCat(field_path, "[", i, "]"), reflection.GetRepeatedMessage(message, field, i)));
    }
  }
  return object;
}

void FromJson(const json& object, Message& message) {
  const Reflection& reflection = *message.GetReflection();
  for (const auto& [name, value] : object.items()) {
    const FieldDescriptor* field = message.GetDescriptor()->FindFieldByName(name);
    if (field == nullptr) continue;
    if (field->is_repeated()) {
      for (const json& element : value) FromJson(element, *reflection.AddMessage(&message, field));
      continue;
    }
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_DOUBLE:
        reflection.SetDouble(&message, field, value.get<double>());
        break;
      case FieldDescriptor::CPPTYPE_INT32:
        reflection.SetInt32(&message, field, value.get<int>());
        break;
      case FieldDescriptor::CPPTYPE_BOOL:
        reflection.SetBool(&message, field, value.get<bool>());
        break;
      case FieldDescriptor::CPPTYPE_STRING:
        reflection.SetString(&message, field, value.get<std::string>());
        break;
      case FieldDescriptor::CPPTYPE_MESSAGE:
        FromJson(value, *reflection.MutableMessage(&message, field));
        break;
      case FieldDescriptor::CPPTYPE_ENUM:
        for (int i = 0; i < field->enum_type()->value_count(); ++i) {
          const EnumValueDescriptor* candidate = field->enum_type()->value(i);
          if (WordOf(*candidate) == value.get<std::string>()) reflection.SetEnum(&message, field, candidate);
        }
        break;
      default:
        break;
    }
  }
}

}  // namespace

absl::StatusOr<std::string> RenderToJson(std::string_view field, const v1::RenderOptions& options) {
  ASSIGN_OR_RETURN(const json object, ToJson(std::string(field), options));
  return object.dump();
}

v1::RenderOptions RenderFromJson(const std::string& text) {
  v1::RenderOptions options;
  FromJson(json::parse(text), options);
  return options;
}

}  // namespace depthtween::server
