"""What a person calls: ``mbpam`` and its verbs, each with its own arguments, on top of nodes and studies."""
