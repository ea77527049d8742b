"""What the functions of URScript can change: the closed list of the dialect.

Source: Universal Robots, Script Manual (e-Series, 5.x). A function that is not listed may change anything.
"""

from __future__ import annotations

from analysis.apps.makers.program_machine import OFF
from analysis.apps.makers.program_parser import word_set

SWITCHES = {
    "path_offset_enable": ("shift", "on"), "path_offset_disable": ("shift", OFF),
    "track_conveyor_linear": ("tracking", "on"), "track_conveyor_circular": ("tracking", "on"),
    "stop_conveyor_tracking": ("tracking", OFF),
    "force_mode": ("tracking", "on"), "end_force_mode": ("tracking", OFF),
    "screw_driving": ("tracking", "on"), "end_screw_driving": ("tracking", OFF),
    "freedrive_mode": ("tracking", "on"), "end_freedrive_mode": ("tracking", OFF),
    "teach_mode": ("tracking", "on"), "end_teach_mode": ("tracking", OFF),
}  # fmt: skip
ELSEWHERE = word_set("speedj speedl")
NOTHING = word_set("""
    acos asin atan atan2 ceil cos d2r exp floor log pow r2d random sin sqrt tan abs and or not xor norm point_dist
    pose_add pose_dist pose_inv pose_sub pose_trans wrench_trans interpolate_pose inv transpose normalize
    get_list_length length size make_list struct get_matrix_dim binary_list_to_integer integer_to_binary_list
    rotvec2rpy rpy2rotvec to_num to_str to_int str_at str_cat str_empty str_find str_len str_sub tostr
    time sleep sync textmsg popup request_boolean_from_primary_client request_float_from_primary_client
    request_integer_from_primary_client request_string_from_primary_client protective_stop
    enter_critical exit_critical join kill stopj stopl is_within_safety_limits is_steady powerdown
    get_actual_joint_positions get_actual_joint_positions_history get_actual_joint_speeds get_actual_tcp_pose
    get_actual_tcp_speed get_actual_tool_flange_pose get_controller_temp get_conveyor_tick_count get_coordinated_joint
    get_forward_kin get_freedrive_status get_inverse_kin get_inverse_kin_has_solution get_joint_temp
    get_joint_torques get_steptime get_target_joint_positions get_target_joint_speeds get_target_joint_accelerations
    get_target_payload get_target_payload_cog get_target_payload_inertia get_target_tcp_pose get_target_tcp_speed
    get_target_waypoint get_tcp_force get_tcp_offset get_tool_accelerometer_reading get_tool_current
    get_tool_temp get_tool_voltage get_jacobian get_jacobian_time_derivative get_mass_matrix
    get_coriolis_and_centrifugal_torques get_friction_torques get_gravity_torques get_base_acceleration
    estimate_payload high_holding_torque_disable high_holding_torque_enable set_base_acceleration
    set_gravity set_payload set_payload_mass set_payload_cog set_target_payload set_payload_inertia
    set_safety_mode_transition_hardness position_deviation_warning zero_ftsensor ft_rtde_input_enable
    tool_contact collision_detection_enable
    force_mode_set_damping force_mode_set_gain_scaling
    path_offset_get path_offset_set path_offset_set_alpha_filter path_offset_set_max_offset
    conveyor_pulse_decode encoder_enable_pulse_decode encoder_enable_set_tick_count encoder_get_tick_count
    encoder_set_tick_count encoder_unwind_delta_tick_count set_conveyor_tick_count
    get_analog_in get_analog_out get_configurable_digital_in get_configurable_digital_out get_digital_in
    get_digital_out get_euromap_input get_euromap_output get_flag get_standard_analog_in get_standard_analog_out
    get_standard_digital_in get_standard_digital_out get_tool_analog_in get_tool_digital_in get_tool_digital_out
    set_analog_inputrange set_analog_out set_analog_outputdomain set_configurable_digital_input_action
    set_configurable_digital_out set_configurable_digital_output_action set_digital_out set_euromap_output
    set_euromap_runstate_dependent_choice set_flag set_gp_boolean_input_action set_gp_boolean_output_action
    set_input_actions_to_default set_output_actions_to_default set_runstate_configurable_digital_output_to_value
    set_runstate_gp_boolean_output_to_value set_runstate_standard_analog_output_to_value
    set_runstate_standard_digital_output_to_value set_runstate_tool_digital_output_to_value
    set_standard_analog_input_domain set_standard_analog_out set_standard_digital_input_action
    set_standard_digital_out set_standard_digital_output_action set_tool_analog_input_domain
    set_tool_analog_output_domain set_tool_communication set_tool_digital_input_action set_tool_digital_out
    set_tool_digital_output_action set_tool_digital_output_mode set_tool_output_mode set_tool_voltage
    modbus_add_signal modbus_delete_signal modbus_get_signal_status modbus_get_time_since_signal_invalid
    modbus_send_custom_command modbus_set_digital_input_action modbus_set_output_register modbus_set_output_signal
    modbus_set_runstate_dependent_choice modbus_set_signal_update_frequency modbus_set_signal_watchdog
    modbus_get_error_code modbus_get_signal_name read_input_boolean_register read_input_float_register
    read_input_integer_register read_output_boolean_register read_output_float_register
    read_output_integer_register read_port_bit read_port_register write_output_boolean_register
    write_output_float_register write_output_integer_register write_port_bit write_port_register
    force assert get_tool_digital_output_mode get_tool_output_mode
    rpc_factory rtde_set_watchdog socket_close socket_get_var socket_init socket_open socket_read_ascii_float
    socket_read_binary_integer socket_read_byte_list socket_read_line socket_read_string socket_send_byte
    socket_send_int socket_send_line socket_send_string socket_set_var
    """)
"""Functions of the manual with no effect on arm, tool and base. `get_inverse_kin` is a target as argument of a move."""
OF_LISTS = word_set("append clear excluding extend insert pop remove slice length size to_string")
NO_TARGETS = word_set("""
    set_tcp force_mode path_offset_set is_within_safety_limits
    get_inverse_kin_has_solution track_conveyor_linear track_conveyor_circular wrench_trans set_base_acceleration
    """)
"""Functions with poses as arguments that are not targets."""
