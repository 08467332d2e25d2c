"""Design methods: from a problem to gains.

registry and methods have the methods by name. program finds observer laws; it stands on observer_law, law_family,
plants, conditions, starts and trust_region. schedule and schedule_programme, static and tuned find gains, and
scene_coupling those of a scene. solution is the answer of `avc solve`. virtual_tool, tool_region and
pair_certificate are for other ends than a wall, and comparison/ compares methods.
"""
